# SPDX-License-Identifier: Apache-2.0
"""The rules of docs/architecture.md that a compiler does not hold. Exit code 1 and one line per fault.

rules.py --root SOURCE_TREE --layers FILE, where FILE has one line per module: "name: the modules it may include".
"""
import argparse
import fnmatch
import pathlib
import re
import sys

MAX_LINES = 500
CODE_FOLDERS = ("include", "src", "apps")  # what ships
ALL_FOLDERS = CODE_FOLDERS + ("tests", "bench", "examples", "tools")

# Third-party headers and the only files of include/, src/ and apps/ that may include them.
OWNERS = {
    "Eigen/": ["include/plumbline/core/types.hpp"],
    "opencv2/": ["include/plumbline/image/*", "src/image/*", "include/plumbline/detect/*", "src/detect/*",
                 "include/plumbline/synth/*", "src/synth/*", "include/plumbline/rectify/remap.hpp",
                 "src/rectify/remap.cpp", "apps/*"],
    "ceres/": ["src/refine/*"],
    "mrcal/": ["src/crosscheck/*"],
    "yaml-cpp/": ["src/io/yaml.cpp"],
    "apriltag/": ["src/detect/*", "src/synth/*"],
    "cairo": ["src/synth/*"],
    "nlohmann/": ["src/io/*", "apps/*"],
    "CLI/": ["apps/*"],
    "fmt/": ["src/*", "apps/*"],
    "glog/": ["apps/main.cpp", "apps/program.cpp", "src/refine/*"],
}
# Of the operating system; not in public headers.
SYSTEM = re.compile(r"^(sys/\w+|unistd|dlfcn|fcntl|dirent|pthread|signal)\.h$")

DECOMPOSITION = re.compile(
    r"\b(JacobiSVD|BDCSVD|\w*EigenSolver|\w*HouseholderQR|CompleteOrthogonalDecomposition|LLT|LDLT|PartialPivLU|"
    r"FullPivLU|RealSchur|ComplexSchur|Tridiagonalization|HessenbergDecomposition)\b"
    r"|[.>](llt|ldlt|lu|partialPivLu|fullPivLu|jacobiSvd|bdcSvd|householderQr|colPivHouseholderQr|"
    r"fullPivHouseholderQr|completeOrthogonalDecomposition|eigenvalues)\(\)")
DECOMPOSITION_OWNER = "src/core/linalg_*.cpp"
# Other files that may name a decomposition, each with its reason.
DECOMPOSITION_ALLOWED = {}

FORBIDDEN_CALL = re.compile(
    r"\bstd::(cout|cerr|clog|terminate|print|println)\b|(?<![\w.>])(std::)?(v?f?printf|puts|fputs|putchar|perror|_?exit|"
    r"_Exit|quick_exit|abort|system)\s*\(|\bfmt::v?print(ln)?\s*\(")
UNFINISHED = re.compile(r"\b(TODO|FIXME|XXX|HACK)\b")


def strip_comments_and_strings(text):
    """The text with comments and string contents blanked out; line numbers stay."""
    pattern = re.compile(
        r'R"(?P<mark>[^()\\ ]{0,16})\(.*?\)(?P=mark)"|//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])+\'', re.S)

    def blank(match):
        piece = match.group(0)
        if piece.startswith("'") and match.start() > 0 and text[match.start() - 1].isalnum():
            return piece  # 1'000'000
        return re.sub(r"[^\n]", " ", piece)

    return pattern.sub(blank, text)


def read_layers(text):
    """{module: every module it may include, itself too}."""
    direct = {}
    for line in text.splitlines():
        if line.strip():
            name, _, deps = line.partition(":")
            direct[name.strip()] = deps.split()
    closed = {}
    for name in direct:
        seen, waiting = set(), [name]
        while waiting:
            module = waiting.pop()
            if module not in seen:
                seen.add(module)
                waiting += direct.get(module, [])
        closed[name] = seen
    return closed


def module_of(path):
    """The module that a file belongs to, None for apps, tests and the rest."""
    parts = path.split("/")
    if parts[:2] == ["include", "plumbline"] and len(parts) > 3:
        return parts[2]
    if parts[0] == "src" and len(parts) > 2:
        return parts[1]
    return None


def matches(path, patterns):
    return any(fnmatch.fnmatchcase(path, pattern) for pattern in patterns)


def check_layers(path, includes, layers):
    module = module_of(path)
    if module is None:
        return
    if module not in layers:
        yield 1, f"module '{module}' is not in the layer map of CMakeLists.txt"
        return
    for line, header in includes:
        parts = header.split("/")
        if parts[0] == "plumbline" and len(parts) > 2 and parts[1] not in layers[module]:
            yield line, f"{module} may not include plumbline/{parts[1]} (the layer map of CMakeLists.txt)"
        elif parts[0] in layers and parts[0] != module and len(parts) > 1:
            yield line, f"{header} is private to module {parts[0]}"


def check_third_party(path, includes):
    for line, header in includes:
        owner = next((prefix for prefix in OWNERS if header.startswith(prefix)), None)
        public = path.startswith("include/")
        if owner:
            if not matches(path, OWNERS[owner]):
                yield line, f"<{header}> may be included in {', '.join(OWNERS[owner])} only"
        elif header.startswith("plumbline/"):
            continue
        elif public and ("." in header or "/" in header):
            yield line, f"a public header includes <{header}>"
        elif header.endswith(".h") and not SYSTEM.match(header):
            yield line, f"<{header}> has no owner: name it in OWNERS of tests/architecture/rules.py"


def check_code(path, code):
    """Names that may not stand in the code of the library."""
    for number, line in enumerate(code.splitlines(), 1):
        if not fnmatch.fnmatchcase(path, DECOMPOSITION_OWNER) and path not in DECOMPOSITION_ALLOWED:
            if found := DECOMPOSITION.search(line):
                yield number, f"{found.group(0)}: decompositions belong in {DECOMPOSITION_OWNER} (core/linalg.hpp)"
        if not path.startswith("apps/") and (found := FORBIDDEN_CALL.search(line)):
            yield number, f"{found.group(0).strip()}: the library never prints, exits or starts programs"


def check_text(path, text):
    lines = text.splitlines()
    if not any("SPDX-License-Identifier: Apache-2.0" in line for line in lines[:3]):
        yield 1, "no SPDX-License-Identifier line"
    if path.endswith((".cpp", ".hpp")) and len(lines) > MAX_LINES:
        yield len(lines), f"{len(lines)} lines; a file has at most {MAX_LINES}"
    if path.endswith(".hpp") and "#pragma once" not in lines:
        yield 1, "no #pragma once"
    if "tests/architecture/" not in path:
        for number, line in enumerate(lines, 1):
            if found := UNFINISHED.search(line):
                yield number, f"{found.group(0)}: finish it, or open an issue"


def check_file(path, text, layers):
    yield from check_text(path, text)
    if not path.endswith((".cpp", ".hpp")):
        return
    code = strip_comments_and_strings(text)
    # From the text, because the names between quotes are blanked in the code; a commented-out line is blank there.
    includes = [(number, found.group(1)) for number, (line, kept) in
                enumerate(zip(text.splitlines(), code.splitlines()), 1)
                if kept.lstrip().startswith("#") and (found := re.match(r'\s*#\s*include\s*[<"]([^>"]+)[>"]', line))]
    if path.startswith(CODE_FOLDERS):
        yield from check_layers(path, includes, layers)
        yield from check_third_party(path, includes)
        yield from check_code(path, code)
    else:
        for line, header in includes:
            if header.startswith("Eigen/"):
                yield line, f"<{header}>: include plumbline/core/types.hpp"


def check_tree(root, layers):
    """Sorted faults "path:line: text" of a source tree."""
    faults, n_files = [], 0
    for folder in ALL_FOLDERS:
        for file in sorted((root / folder).rglob("*")):
            path = file.relative_to(root).as_posix()
            if file.suffix not in (".cpp", ".hpp", ".py", ".sh") or not file.is_file() or "/build/" in f"/{path}":
                continue
            n_files += 1
            for line, fault in check_file(path, file.read_text(encoding="utf-8"), layers):
                faults.append(f"{path}:{line}: {fault}")
    return faults, n_files


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=pathlib.Path, required=True)
    parser.add_argument("--layers", type=pathlib.Path, required=True)
    arguments = parser.parse_args()
    faults, n_files = check_tree(arguments.root, read_layers(arguments.layers.read_text(encoding="utf-8")))
    print("\n".join(faults) if faults else f"{n_files} files keep the rules")
    return 1 if faults or n_files == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
