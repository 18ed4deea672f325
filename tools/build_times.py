#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The slowest steps of the last build, from Ninja's log: tools/build_times.py [BUILD_FOLDER]"""
import pathlib
import sys

folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "build")
steps = {}
for line in (folder / ".ninja_log").read_text().splitlines()[1:]:
    start, end, _, output, command = line.split("\t")
    # A command with two outputs stands twice in the log; a later line replaces an earlier one.
    steps[command] = ((int(end) - int(start)) / 1000, output)
seconds = sorted(steps.values(), reverse=True)
print(f"{len(seconds)} steps, {sum(s for s, _ in seconds):.0f} s in all (wall time of each step, added up)")
for s, output in seconds[:20]:
    print(f"{s:7.1f} s  {output}")
