#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""run_tests.py FOLDER NAME [MESON TEST OPTION...]: runs the tests of a build folder, then lists failed and skipped tests by name.

The counts are of single tests (lines of TAP), not of programs. If PELL_COUNTS is set, "NAME PASSED FAILED SKIPPED" is added to that file.
"""
import collections
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time

TAP = re.compile(r"(not )?ok\b[ \d]*(?:- )?([^#]*)(?:# *(SKIP)\b *(.*))?", re.IGNORECASE)
DETAILS = 40  # lines of comment that are shown behind a failed test


def count(log):
    """Lists of failed names, {reason: names skipped}, and the number passed."""
    passed, failed, skipped = 0, [], collections.defaultdict(list)
    for line in log.read_text("utf-8", "replace").splitlines():
        test = json.loads(line)
        name, result = test["name"].split(" / ")[-1], test["result"]
        rows = bad = 0
        open_failure = False  # the last row failed, so comments tell why
        for row in (test.get("stdout") or "").splitlines():
            found = TAP.match(row)
            if not found:
                if open_failure and row.startswith("# ") and failed[-1].count("\n") < DETAILS:
                    failed[-1] += "\n    " + row[2:]
                continue
            rows += 1
            open_failure = bool(found[1]) and not found[3]
            title = f"{name}: {found[2].strip()}"
            if found[3]:
                skipped[found[4].strip() or "no reason given"].append(title)
            elif found[1]:
                failed.append(title)
                bad += 1
            else:
                passed += 1
        plan = re.search(r"^1\.\.(\d+)", test.get("stdout") or "", re.MULTILINE)
        if plan and rows < int(plan[1]):
            failed.append(f"{name}: {result.lower()} after {rows} of {plan[1]} tests, exit status {test.get('returncode')}")
        elif result in ("OK", "EXPECTEDFAIL"):
            passed += not rows
        elif result == "SKIP":
            if not rows:
                skipped[(test.get("stdout") or "").strip().split("\n")[-1] or "no reason given"].append(name)
        elif not bad:
            failed.append(f"{name}: {result.lower()}, exit status {test.get('returncode')}")
    return passed, failed, skipped


def comma_locale(folder, env):
    """Makes a locale with a decimal comma for the tests of number parsing, where the system has the sources of one."""
    target = folder / "locale" / "de_DE.UTF-8"
    if shutil.which("localedef") and pathlib.Path("/usr/share/i18n/locales/de_DE").exists():
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            subprocess.run(["localedef", "-c", "-i", "de_DE", "-f", "UTF-8", str(target)], check=False,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        env["LOCPATH"] = str(target.parent.resolve())


def main():
    folder, name, options = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3:]
    # A test's own limit is for an idle machine: it ends what hangs, it judges no speed.
    command = ["meson", "test", "-C", str(folder), "--no-rebuild", "--print-errorlogs", "--timeout-multiplier", "4", *options]
    env = dict(os.environ)
    comma_locale(folder, env)
    if name == "test-tsan" and subprocess.run(["setarch", "-R", "true"], check=False, stderr=subprocess.DEVNULL).returncode == 0:
        command = ["setarch", "-R", *command]  # older thread sanitizers fail where the kernel randomises 32 bits of addresses
    log = folder / "meson-logs" / "testlog.json"
    log.unlink(missing_ok=True)
    start = time.monotonic()
    status = subprocess.run(command, env=env, check=False).returncode
    seconds = time.monotonic() - start
    if log.exists():
        passed, failed, skipped = count(log)
        if status and not failed:
            failed.append(f"meson test: exit status {status}")
    else:
        passed, failed, skipped = 0, [f"meson test: exit status {status}, no log"], {}
    total_skipped = sum(map(len, skipped.values()))
    print()
    for reason, names in sorted(skipped.items()):
        print(f"skipped ({reason}): {', '.join(names)}")
    for title in failed:
        print(f"FAILED {title}")
    print(f"{name}: {passed} passed, {len(failed)} failed, {total_skipped} skipped, {seconds:.0f} s")
    if "PELL_COUNTS" in os.environ:
        with open(os.environ["PELL_COUNTS"], "a", encoding="utf-8") as counts:
            counts.write(f"{name} {passed} {len(failed)} {total_skipped}\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
