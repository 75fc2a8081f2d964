/* SPDX-License-Identifier: MIT
 *
 * mpi.c - `pellucid-mpi`: `pellucid render` by all ranks of an MPI job. The only file that uses MPI; the rendering thread calls it.
 */
#include "cli/mpi_bench.h"

#include "render/communicator.h"

#include <mpi.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { COUNTERS = 64, TAG = 1 }; /* counters of work items; one is used at a time, and the one half a cycle ahead is cleared */

#define OVER (INT64_MAX / 4)
#define PART ((size_t) 1 << 30) /* bytes of one message, whose count is an int */

struct ranks {
    MPI_Comm comm;
    MPI_Win window;
    int64_t *counters; /* on rank 0 */
    int now;
};

static void begin(void *user)
{
    struct ranks *r = user;
    int rank;

    r->now = (r->now + 1) % COUNTERS;
    MPI_Comm_rank(r->comm, &rank);
    if (rank == 0) {
        const int64_t none = 0;
        int64_t old;
        MPI_Fetch_and_op(&none, &old, MPI_INT64_T, 0, (MPI_Aint) ((r->now + COUNTERS / 2) % COUNTERS), MPI_REPLACE, r->window);
        MPI_Win_flush(0, r->window);
    }
    MPI_Barrier(r->comm);
}

static int64_t take(void *user, int64_t count)
{
    struct ranks *r = user;
    int64_t first = OVER;

    MPI_Fetch_and_op(&count, &first, MPI_INT64_T, 0, (MPI_Aint) r->now, MPI_SUM, r->window);
    MPI_Win_flush(0, r->window);
    return first;
}

static void stop(void *user)
{
    struct ranks *r = user;
    const int64_t over = OVER;
    int64_t old;

    MPI_Fetch_and_op(&over, &old, MPI_INT64_T, 0, (MPI_Aint) r->now, MPI_REPLACE, r->window);
    MPI_Win_flush(0, r->window);
}

static bool any(void *user, bool mine)
{
    struct ranks *r = user;
    int in = mine, out = mine;

    MPI_Allreduce(&in, &out, 1, MPI_INT, MPI_LOR, r->comm);
    return out;
}

static void broadcast(void *user, void *data, size_t size)
{
    struct ranks *r = user;

    for (size_t at = 0; at < size; at += PART)
        MPI_Bcast((char *) data + at, (int) (size - at < PART ? size - at : PART), MPI_BYTE, 0, r->comm);
}

static void send(void *user, int to, const void *data, size_t size)
{
    struct ranks *r = user;

    MPI_Send(data, (int) size, MPI_BYTE, to, TAG, r->comm);
}

static size_t receive(void *user, int from, void *data, size_t size)
{
    struct ranks *r = user;
    MPI_Status status;
    int count = 0;

    MPI_Recv(data, (int) size, MPI_BYTE, from, TAG, r->comm, &status);
    MPI_Get_count(&status, MPI_BYTE, &count);
    return (size_t) count;
}

static const struct command commands[] = {
    { "render", "INPUT", "an image by all ranks of an MPI job",
      "Works like `pellucid render -m path-trace`, which documents the options. Each idle rank takes the next block of samples, and rank 0 "
      "writes the image, which is bit-identical for any number of ranks and threads. Every rank reads INPUT. With --checkpoint FILE the "
      "ranks save their samples in FILE, FILE.rank1, FILE.rank2 and so on; the same command with any number of ranks resumes from them.\n",
      "  mpirun -n 4 pellucid-mpi render scene.json -m path-trace --samples 64 --threads 1 -o image.exr\n",
      OPTIONS_SCENE | OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_FILE | OPTIONS_PARTS | OPTIONS_ENGINE, 1, 1, command_render },
    { "bench", "INPUT", "the measured cost of a shared run, and a prediction for more ranks",
      "Renders INPUT on all ranks, takes blocks from the counter, and adds films of the size of the whole image; then prints the predicted "
      "time of a run with up to 10,000 ranks on the same network.\n",
      "  mpirun -n 2 pellucid-mpi bench scene.json -m path-trace --samples 8 --threads 1\n",
      OPTIONS_SCENE | OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_ENGINE, 1, 1, command_mpi_bench },
};

int main(int argc, char **argv)
{
    struct ranks ranks = { .comm = MPI_COMM_WORLD };
    struct pell_communicator comm = { &ranks,     .begin = begin,         .take = take, .stop = stop,
                                      .any = any, .broadcast = broadcast, .send = send, .receive = receive };
    const struct program program = {
        .name = "pellucid-mpi",
        .about = "renders translucent objects on many machines",
        .start = "",
        .commands = commands,
        .num_commands = PELL_COUNT(commands),
        .communicator = &comm,
    };
    int provided, code;

    MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
    MPI_Comm_rank(ranks.comm, &comm.rank);
    MPI_Comm_size(ranks.comm, &comm.ranks);
    MPI_Win_allocate((MPI_Aint) (comm.rank == 0 ? COUNTERS * sizeof(int64_t) : 0), sizeof(int64_t), MPI_INFO_NULL, ranks.comm,
                     &ranks.counters, &ranks.window);
    if (comm.rank == 0)
        memset(ranks.counters, 0, COUNTERS * sizeof(int64_t));
    MPI_Barrier(ranks.comm);
    MPI_Win_lock_all(0, ranks.window);
    code = cli_main(&program, argc, argv);
    if (code != EXIT_OK && !comm.finished) { /* the other ranks wait for this one; errors common to all are reported by rank 0 */
        if (comm.rank > 0)
            sleep(1);
        MPI_Abort(ranks.comm, code);
    }
    MPI_Win_unlock_all(ranks.window);
    MPI_Win_free(&ranks.window);
    MPI_Finalize();
    return code;
}
