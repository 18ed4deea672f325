# SPDX-License-Identifier: Apache-2.0
"""A file compiled for an instruction set beyond the baseline must not define a function that the linker may take for another
file's: a weak symbol of it, chosen at link time, would crash an older processor far from the kernel.

kernel_symbols_test.py OBJECT...
"""
import subprocess
import sys


def weak_symbols(listing):
    """Names that `nm` marks as weak or unique among the defined ones."""
    found = []
    for line in listing.splitlines():
        parts = line.split(maxsplit=2)
        if len(parts) == 3 and parts[1] in "WVu":
            found.append(parts[2])
    return found


def main(objects):
    assert weak_symbols("0000 t a\n0000 W std::f()\n     U g\n0000 R k") == ["std::f()"]
    faults = []
    for path in objects:
        listing = subprocess.run(["nm", "-C", path], capture_output=True, text=True, check=True).stdout
        assert "Kernels" in listing, f"{path} holds no kernels"
        faults += [f"{path}: weak symbol {name}" for name in weak_symbols(listing)]
    print("\n".join(faults) if faults else f"{len(objects)} objects keep to themselves")
    return 1 if faults or not objects else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
