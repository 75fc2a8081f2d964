/* SPDX-License-Identifier: MIT
 * mpi_bench.h - a command of pellucid-mpi. */
#ifndef PELL_CLI_MPI_BENCH_H
#define PELL_CLI_MPI_BENCH_H

#include "cli/cli.h"

enum exit_code command_mpi_bench(struct cli *cli);

#endif
