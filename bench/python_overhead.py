#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Overhead of calls: prints the time of the import and of profiles over arrays, as in docs/guide/python.md."""
import subprocess
import sys
import time

import numpy as np

import pellucid

COUNT = 100_000


def best(function, rounds=5):
    """Seconds of the fastest round."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def main():
    code = "import time; t = time.perf_counter(); import pellucid; print(time.perf_counter() - t)"
    whole = min(float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True).stdout) for _ in range(5))
    code = "import numpy, time; t = time.perf_counter(); import pellucid; print(time.perf_counter() - t)"
    own = min(float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True).stdout) for _ in range(5))
    print(f"import pellucid: {1e3 * whole:.0f} ms, {1e3 * own:.0f} ms of it without numpy")
    rng = np.random.default_rng(1)
    sigma_a, sigma_s, r = rng.uniform(0.001, 1, COUNT), rng.uniform(0.5, 5, COUNT), rng.uniform(0.01, 5, COUNT)
    red = pellucid.Profile(pellucid.Medium.material("marble"))
    print(f"R(r) of one profile at {COUNT} radii: {1e9 * best(lambda: red(r)) / COUNT:.0f} ns each")
    print(f"one call of it for one radius: {1e6 * best(lambda: [red(1.0) for _ in range(1000)]) / 1000:.1f} us")
    print(f"a profile each for {COUNT} media: {1e6 * best(lambda: pellucid.profile_at(1.0, sigma_a, sigma_s)) / COUNT:.2f} us each")
    print(f"its total: {1e6 * best(lambda: pellucid.total_reflectance(sigma_a, sigma_s)) / COUNT:.2f} us each")


if __name__ == "__main__":
    main()
