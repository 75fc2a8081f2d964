#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""run_fuzz.py FOLDER SECONDS: divides SECONDS of wall time among the fuzz targets of a build folder, two at a time.

A target is an executable that is defined in fuzz/. Its seeds are the files of corpus/NAME in the folder of its source (NAME without
"fuzz_"), its dictionary NAME.dict there. New inputs are kept in FOLDER/corpus/NAME, failing ones in FOLDER/crashes.

FUZZ_SEED (environment): the random seed; 0, which is the default, takes another one each time. A build that must attribute a failure to a
change (.ci/run) names one: from the same sources and an empty FOLDER every run is the same, as far as its time limit permits.
"""
import concurrent.futures
import json
import os
import pathlib
import subprocess
import sys

AT_ONCE = 2


def targets(folder):
    listed = subprocess.run(["meson", "introspect", "--targets", str(folder)], check=True, capture_output=True, text=True).stdout
    root = pathlib.Path(__file__).resolve().parent.parent
    for target in json.loads(listed):
        if target["type"] == "executable" and pathlib.Path(target["defined_in"]).resolve().parent == root / "fuzz":
            sources = [pathlib.Path(name) for group in target["target_sources"] for name in group.get("sources", [])]
            yield target["name"], pathlib.Path(target["filename"][0]), next(s.parent for s in sources if s.stem == target["name"])


def fuzz(folder, name, program, home, seconds):
    short = name.removeprefix("fuzz_")
    found, crashes = folder / "corpus" / name, folder / "crashes"
    found.mkdir(parents=True, exist_ok=True)
    crashes.mkdir(exist_ok=True)
    command = [str(program), f"-max_total_time={seconds}", "-timeout=10", "-rss_limit_mb=2048", "-print_final_stats=1",
               f"-artifact_prefix={crashes}/{name}-"]
    seed = int(os.environ.get("FUZZ_SEED") or "0")
    if seed:
        command.append(f"-seed={seed}")
    dictionary = home / f"{short}.dict"
    if dictionary.exists():
        command.append(f"-dict={dictionary}")
    seeds = home / "corpus" / short
    run = subprocess.run([*command, str(found), *([str(seeds)] if seeds.is_dir() else [])], check=False, text=True, errors="replace",
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=seconds * 4 + 120)
    stats = dict(line[6:].split(":", 1) for line in run.stdout.splitlines() if line.startswith("stat::") and ":" in line[6:])
    return run.returncode, stats, run.stdout


def reason(output):
    """The lines that state the failures, for the end of a long log."""
    said = [line.strip() for line in output.splitlines() if "ERROR: " in line or "runtime error: " in line or "SUMMARY: " in line]
    return "; ".join(said) or (output.splitlines() or ["no output"])[-1]


def main():
    folder, budget = pathlib.Path(sys.argv[1]).resolve(), float(sys.argv[2])
    todo = list(targets(folder))
    passed = failed = 0
    reasons = []
    if not todo:
        print("fuzz-short: no targets yet")
    else:
        each = min(round(budget), max(3, round(budget * AT_ONCE / len(todo))))
        os.environ.setdefault("ASAN_OPTIONS", "detect_leaks=1:allocator_may_return_null=1")
        os.environ.setdefault("UBSAN_OPTIONS", "halt_on_error=1:print_stacktrace=1")
        with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
            jobs = {name: pool.submit(fuzz, folder, name, program, home, each) for name, program, home in todo}
            for name, job in jobs.items():
                try:
                    status, stats, output = job.result()
                except (subprocess.TimeoutExpired, OSError) as error:
                    status, stats, output = -1, {}, str(error)
                print(f"{name}: {'ok' if status == 0 else 'FAILED'}, {stats.get('number_of_executed_units', '?').strip()} runs in {each} s")
                if status == 0:
                    passed += 1
                else:
                    failed += 1
                    print("\n".join(output.splitlines()[-60:]))
                    reasons.append(f"{name}: {reason(output)}")
    for line in reasons:
        print(line)
    print(f"fuzz-short: {passed} passed, {failed} failed")
    if "PELL_COUNTS" in os.environ:
        with open(os.environ["PELL_COUNTS"], "a", encoding="utf-8") as counts:
            counts.write(f"fuzz-short {passed} {failed} 0\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
