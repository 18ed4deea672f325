#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Keeps the generated parts of README.md true.

    tools/readme.py           writes them anew
    tools/readme.py --check   fails, with a diff, when they are not what the program prints

A generated table:                                    Commands with their output:
    <!-- generated: plumbline list lenses --markdown -->   <!-- run -->
    ...                                                    ```console
    <!-- end -->                                           $ plumbline list lenses
                                                           ...
                                                           ```
                                                           <!-- end -->

The commands of all run blocks run one after the other in one empty folder, in which `img` holds the demo photographs
(PLUMBLINE_DEMO_IMAGES). Without them the run blocks are skipped. In the check, numbers may differ by 1e-3 of
themselves (other processors round differently), numbers under 1e-6 and durations by anything; the words may not differ.
"""
import argparse
import difflib
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"(<!-- (?P<kind>generated: (?P<command>[^\n]*)|run) -->\n)(?P<body>.*?)(<!-- end -->)", re.S)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
DURATION = re.compile(r"\b\d+(\.\d+)? ?(ms|s)\b")


def run(command, folder, build):
    """What a command prints on stdout and stderr together; raises when it fails."""
    path = f"{build}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(command, shell=True, cwd=folder, text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, env={**os.environ, "PATH": path}, timeout=120)
    if done.returncode != 0:
        raise SystemExit(f"README.md: '{command}' ended with {done.returncode}:\n{done.stdout}")
    return done.stdout


def run_block(body, folder, build):
    """The body again, with the output of each `$ ` line as it is now; a trailing backslash continues a line."""
    commands = re.findall(r"^\$ ((?:.*\\\n)*.*)$", body, re.M)
    text = "".join(f"$ {command}\n{run(command, folder, build)}" for command in commands)
    return f"```console\n{text}```\n"


def same(old, new):
    """Whether two texts agree up to rounding and durations."""
    old, new = DURATION.sub("T", old), DURATION.sub("T", new)
    if NUMBER.sub("#", old) != NUMBER.sub("#", new):
        return False
    pairs = zip(map(float, NUMBER.findall(old)), map(float, NUMBER.findall(new)))
    # Below 1e-3 (differences of two solvers, in px) only rounding of the machine is left.
    return all(abs(a - b) <= max(1e-3 if max(abs(a), abs(b)) < 1e-3 else 1e-6, 1e-3 * max(abs(a), abs(b)))
               for a, b in pairs)


def main():
    parser = argparse.ArgumentParser(description="Keeps the generated parts of README.md true.")
    parser.add_argument("--check", action="store_true", help="change nothing; exit code 1 on a difference")
    parser.add_argument("--build", default=ROOT / "build", type=pathlib.Path, help="where the program plumbline is")
    parser.add_argument("--readme", default=ROOT / "README.md", type=pathlib.Path)
    args = parser.parse_args()
    build = args.build.resolve()
    images = os.environ.get("PLUMBLINE_DEMO_IMAGES")
    text = args.readme.read_text()
    differences = []
    with tempfile.TemporaryDirectory() as folder:
        if images:
            (pathlib.Path(folder) / "img").symlink_to(images)

        def renew(block):
            old = block["body"]
            if block["command"]:
                new = run(block["command"], folder, build).rstrip() + "\n"
            elif images:
                new = run_block(old, folder, build)
            else:
                # The form of GoogleTest's own line, so that ./dev test counts it among the skipped tests.
                print("[  SKIPPED ] Readme.RunBlocks (0 ms)")
                return block[0]
            name = block["command"] or "run block"
            if not same(old, new):
                differences.append("".join(difflib.unified_diff(
                    old.splitlines(True), new.splitlines(True), f"README.md, {name}", f"{name}, now")))
            return block[1] + new + block[5]

        renewed = BLOCK.sub(renew, text)
    if args.check:
        if os.environ.get("PLUMBLINE_REQUIRE_DATA") == "1" and not images:
            raise SystemExit("PLUMBLINE_REQUIRE_DATA=1, but PLUMBLINE_DEMO_IMAGES is not set")
        if differences:
            print("\n".join(differences))
            raise SystemExit("README.md is not what the program prints: run tools/readme.py")
        print(f"[       OK ] Readme.Blocks ({len(BLOCK.findall(text))} blocks)")
    elif renewed != text:
        args.readme.write_text(renewed)


if __name__ == "__main__":
    main()
