#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_mpi.py PROGRAM ROOT MPI_PROGRAM: `pellucid-mpi` under mpirun: bit-identical to one process, for any number of ranks and threads,
and after killed ranks."""
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

from cli_test import ROOT, Skip, clean_environment, main, names, need, run, test, text, works

MPI = os.path.abspath(sys.argv[3])
MPIRUN = ['mpirun', '--allow-run-as-root', '--oversubscribe', '--mca', 'btl_base_warn_component_unused', '0']
TRACE = ['render', 'bunny.obj', '--unit', '1mm', '--material', 'marble', '-m', 'path-trace', '--set', 'events=64', '--width', '48',
         '--height', '36', '--msaa', '2', '--light-samples', '1']
FEW = [*TRACE, '--samples', '28']
MANY = [*TRACE, '--samples', '1200']
SAVED = ['--checkpoint', 'state.ckpt', '--checkpoint-every', '100ms']


def environment():
    return clean_environment(OMPI_MCA_rmaps_base_oversubscribe='1', OMPI_ALLOW_RUN_AS_ROOT='1', OMPI_ALLOW_RUN_AS_ROOT_CONFIRM='1')


def ranks(folder, count, *arguments, **options):
    if not shutil.which('mpirun'):
        raise Skip('there is no mpirun')
    return subprocess.run([*MPIRUN, '-n', str(count), MPI, *arguments], cwd=folder, env=environment(), check=False, capture_output=True,
                          stdin=subprocess.DEVNULL, timeout=300, **options)


def run_ranks(folder, count, *arguments):
    done = ranks(folder, count, *arguments)
    need(done.returncode == 0, count, 'ranks', arguments, 'ended with', done.returncode, done.stderr)
    return done


def same(folder, a, b):
    need((folder / a).read_bytes() == (folder / b).read_bytes(), a, 'and', b, 'differ')


def begun(folder, count):
    """A job whose ranks have all written their checkpoints once, and the process of each rank."""
    if not shutil.which('mpirun'):
        raise Skip('there is no mpirun')
    child = subprocess.Popen([*MPIRUN, '-n', str(count), MPI, *MANY, *SAVED, '--threads', '1', '-o', 'killed.pfm'], cwd=folder,
                             env=environment(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                             preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    files = {'state.ckpt', *(f'state.ckpt.rank{i}' for i in range(1, count))}
    end = time.monotonic() + 120
    while not files <= set(names(folder)):
        need(child.poll() is None and time.monotonic() < end, 'it ended before', child.poll())
        time.sleep(0.02)
    processes = {}
    for entry in pathlib.Path('/proc').iterdir():
        try:
            if entry.name.isdigit() and os.readlink(entry / 'exe') == os.path.realpath(MPI) and os.readlink(entry / 'cwd') == str(folder):
                words = (entry / 'environ').read_bytes().split(b'\0')
                processes[int(next(w for w in words if w.startswith(b'OMPI_COMM_WORLD_RANK=')).split(b'=')[1])] = int(entry.name)
        except (OSError, StopIteration):
            pass
    need(len(processes) == count, processes)
    return child, processes


@test('the man page is the one that docs/man/make_man.py makes of the help')
def _(folder):
    make = [sys.executable, os.path.join(ROOT, 'docs/man/make_man.py'), MPI, '--whole']
    page = subprocess.run(make, check=True, capture_output=True).stdout
    need(pathlib.Path(ROOT, 'docs/man/pellucid-mpi.1').read_bytes() == page, 'make_man.py pellucid-mpi --whole > docs/man/pellucid-mpi.1')


@test('1, 2, 3 and 5 ranks of 1 and 2 threads give the bits of one process')
def _(folder):
    works(folder, *FEW, '-o', 'whole.pfm')
    for count in (1, 2, 3, 5):
        for threads in ('1', '2'):
            run_ranks(folder, count, *FEW, '--threads', threads, '-o', 'shared.pfm')
            same(folder, 'whole.pfm', 'shared.pfm')


@test('--target-error is judged on the whole: it ends at the same sample as one process')
def _(folder):
    until = [*TRACE, '--samples', '4000', '--target-error', '30%']
    one = works(folder, *until, '-o', 'whole.pfm')
    all_ = run_ranks(folder, 3, *until, '--threads', '1', '-o', 'shared.pfm')
    same(folder, 'whole.pfm', 'shared.pfm')
    said = [text(d.stderr).split(' samples per pixel, relative error ')[0].split()[-1] for d in (one, all_)]
    need(said[0] == said[1] and 16 < int(said[0]) < 4000, said)


@test('SIGKILL of one rank: the error names it, and another number of ranks resumes to the same bits')
def _(folder):
    works(folder, *MANY, '-o', 'whole.pfm')
    child, processes = begun(folder, 3)
    os.kill(processes[2], signal.SIGKILL)
    _, err = child.communicate(timeout=60)
    need(child.returncode != 0 and b'rank 2' in err and 'killed.pfm' not in names(folder), child.returncode, err)
    done = run_ranks(folder, 2, *MANY, *SAVED, '--threads', '1', '-o', 'resumed.pfm')
    same(folder, 'whole.pfm', 'resumed.pfm')
    need(b'2 further ranks' in done.stderr, done.stderr)
    need([n for n in names(folder) if n.startswith('state.ckpt')] == ['state.ckpt'], names(folder))
    works(folder, *MANY, '--checkpoint', 'state.ckpt', '-o', 'alone.pfm')  # existing files are complete
    same(folder, 'whole.pfm', 'alone.pfm')


@test('SIGKILL of all ranks, twice: five, then one, then two of them; the files merge as parts, too')
def _(folder):
    works(folder, *MANY, '-o', 'whole.pfm')
    child, processes = begun(folder, 5)
    for process in processes.values():
        os.kill(process, signal.SIGKILL)
    child.communicate(timeout=60)
    done = run(folder, 'merge', *(n for n in names(folder) if n.startswith('state.ckpt') and not n.endswith('.lock')), '--partial', '-o',
               'some.pfm')
    need(done.returncode == 0 and b'a partial image' in done.stderr, done.stderr)
    run_ranks(folder, 1, *TRACE, '--samples', '600', *SAVED, '-o', 'killed.pfm')
    run_ranks(folder, 2, *MANY, *SAVED, '--threads', '2', '-o', 'resumed.pfm')
    same(folder, 'whole.pfm', 'resumed.pfm')


@test('SIGTERM: 75, a picture of what is there, every rank keeps its samples')
def _(folder):
    works(folder, *MANY, '-o', 'whole.pfm')
    child, processes = begun(folder, 2)
    for process in processes.values():
        os.kill(process, signal.SIGTERM)
    _, err = child.communicate(timeout=60)
    need(child.returncode == 75 and 'killed.pfm' in names(folder), child.returncode, err)
    run_ranks(folder, 3, *MANY, *SAVED, '--threads', '1', '-o', 'resumed.pfm')
    same(folder, 'whole.pfm', 'resumed.pfm')


@test('Ctrl-C to mpirun: no half-written file, and what every rank has saved is resumed')
def _(folder):
    works(folder, *MANY, '-o', 'whole.pfm')
    child, _ = begun(folder, 3)
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=60)
    need(child.returncode != 0, child.returncode, err)
    files = [n for n in names(folder) if n.startswith('state.ckpt') and not n.endswith('.lock')]
    works(folder, 'merge', *files, '--partial', '-o', 'some.pfm')  # every file is complete
    need(not [n for n in names(folder) if n.startswith('.pellucid-')] or 'killed.pfm' not in names(folder), names(folder))
    run_ranks(folder, 2, *MANY, *SAVED, '--threads', '1', '-o', 'resumed.pfm')
    same(folder, 'whole.pfm', 'resumed.pfm')


@test('a checkpoint of another seed or a damaged one ends all ranks with its name, and stays; other methods are refused')
def _(folder):
    run_ranks(folder, 2, *FEW, *SAVED, '-o', 'a.pfm')
    good = (folder / 'state.ckpt').read_bytes()
    (folder / 'state.ckpt.rank1').write_bytes(good[:-7])
    for more, word in ((['--seed', '7'], b'another seed'), ([], b'state.ckpt.rank1')):
        done = ranks(folder, 2, *FEW, *SAVED, *more, '-o', 'no.pfm')
        need(done.returncode == 3 and word in done.stderr, done.returncode, done.stderr)
        need((folder / 'state.ckpt').read_bytes() == good and (folder / 'state.ckpt.rank1').read_bytes() == good[:-7], 'files changed')
    done = ranks(folder, 2, 'render', 'bunny.obj', '--unit', '1mm', '-o', 'no.pfm')
    need(done.returncode == 2 and b'path-trace' in done.stderr and 'no.pfm' not in names(folder), done.returncode, done.stderr)


@test('bench: what a run is made of, and a model that falls and bends')
def _(folder):
    done = ranks(folder, 2, 'bench', 'bunny.obj', '--unit', '1mm', '--material', 'marble', *TRACE[6:], '--samples', '4', '--threads', '1',
                 '--json')
    answer = json.loads(done.stdout)
    need(done.returncode == 0 and answer['ranks'] == 2 and len(answer['rows']) == 5, done.returncode, done.stdout, done.stderr)
    need(all(r['ms'] >= 0 for r in answer['rows']), answer)
    model = answer['model']
    need([m['ranks'] for m in model] == [2 ** i for i in range(14)] + [10000], model)
    need(all(a['efficiency'] >= b['efficiency'] > 0 for a, b in zip(model, model[1:])), model)
    need(model[0]['efficiency'] == 1 and model[0]['reduce_seconds'] == 0 < model[-1]['reduce_seconds'], model)


sys.exit(main())
