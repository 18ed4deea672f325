# SPDX-License-Identifier: Apache-2.0
"""Each rule of rules.py goes red on a small bad tree, and stays green on a good one."""
import pathlib
import tempfile
import unittest

import rules

LAYERS = rules.read_layers("core:\ngeometry: core\nlens: core\nrig: geometry lens\nio: rig\nrefine: rig\n")
SPDX = "// SPDX-License-Identifier: Apache-2.0\n"


def faults(path, text, spdx=True):
    """Faults of a tree with this one file (a header is given its #pragma once)."""
    if spdx:
        text = SPDX + ("#pragma once\n" if path.endswith(".hpp") else "") + text
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / path
        file.parent.mkdir(parents=True)
        file.write_text(text, encoding="utf-8")
        found, n_files = rules.check_tree(pathlib.Path(folder), LAYERS)
        assert n_files == 1, path
        return found


class Rules(unittest.TestCase):
    def red(self, path, text, words, **options):
        found = faults(path, text, **options)
        self.assertEqual(len(found), 1, found)
        self.assertIn(words, found[0])
        return found[0]

    def green(self, path, text, **options):
        self.assertEqual(faults(path, text, **options), [])

    def test_layers_are_transitive(self):
        self.assertEqual(LAYERS["io"], {"io", "rig", "geometry", "lens", "core"})
        self.assertEqual(LAYERS["core"], {"core"})

    def test_layers(self):
        self.red("src/lens/a.cpp", '#include "plumbline/rig/rig.hpp"\n', "lens may not include plumbline/rig")
        self.red("include/plumbline/geometry/a.hpp", '#include "plumbline/lens/lens.hpp"\n', "geometry may not")
        self.red("src/io/formats/a.cpp", '#  include "plumbline/refine/refine.hpp"\n', "io may not")
        self.green("src/io/a.cpp", '#include "plumbline/core/text.hpp"\n#include "plumbline/io/files.hpp"\n')
        self.green("src/lens/a.cpp", '// #include "plumbline/rig/rig.hpp"\n/*\n#include "plumbline/rig/rig.hpp"\n*/\n')
        self.green("apps/a.cpp", '#include "plumbline/io/files.hpp"\n')
        self.red("src/attic/a.cpp", "int x;\n", "not in the layer map")

    def test_private_headers_stay_private(self):
        self.red("src/refine/a.cpp", '#include "io/yaml.hpp"\n', "private to module io")
        self.red("src/rig/a.cpp", '#include "refine/normal.hpp"\n', "private to module refine")
        self.green("src/io/a.cpp", '#include "io/yaml.hpp"\n')

    def test_line_number(self):
        self.assertIn("a.cpp:4:", self.red("src/lens/a.cpp", 'int x;\n\n#include <ceres/jet.h>\n', "ceres"))

    def test_third_party_headers_have_one_owner(self):
        for path, header in [("src/io/a.cpp", "ceres/problem.h"), ("src/refine/a.cpp", "mrcal/mrcal.h"),
                             ("src/io/formats/kalibr.cpp", "yaml-cpp/yaml.h"), ("src/rig/a.cpp", "apriltag/apriltag.h"),
                             ("src/rig/a.cpp", "cairo-pdf.h"), ("src/rig/a.cpp", "opencv2/core.hpp"),
                             ("src/rig/a.cpp", "CLI/CLI.hpp"), ("src/rig/a.cpp", "nlohmann/json.hpp"),
                             ("src/rig/a.cpp", "Eigen/Dense"), ("apps/a.cpp", "ceres/ceres.h")]:
            self.red(path, f"#include <{header}>\n", "only")
        self.red("src/rig/a.cpp", "#include <suitesparse/cholmod.h>\n", "has no owner")
        self.green("src/refine/a.cpp", "#include <ceres/problem.h>\n#include <fmt/format.h>\n#include <vector>\n")
        self.green("src/io/yaml.cpp", "#include <yaml-cpp/parser.h>\n")
        self.green("apps/a.cpp", "#include <CLI/CLI.hpp>\n#include <opencv2/core.hpp>\n")
        self.green("src/io/a.cpp", "#include <unistd.h>\n#include <sys/stat.h>\n")

    def test_public_headers_show_no_third_party(self):
        for header in ["ceres/jet.h", "mrcal/mrcal.h", "apriltag/apriltag.h", "yaml-cpp/yaml.h", "fmt/format.h",
                       "nlohmann/json.hpp", "opencv2/core.hpp"]:
            self.red("include/plumbline/rig/a.hpp", f"#include <{header}>\n", "only")
        self.red("include/plumbline/rig/a.hpp", "#include <unistd.h>\n", "a public header includes")
        self.red("include/plumbline/rig/a.hpp", '#include "rig/private.hpp"\n', "a public header includes")
        self.green("include/plumbline/rig/a.hpp", '#include <string>\n#include "plumbline/core/types.hpp"\n')

    def test_eigen_comes_in_by_one_header(self):
        self.green("include/plumbline/core/types.hpp", "#include <Eigen/Dense>\n")
        self.red("include/plumbline/core/linalg.hpp", "#include <Eigen/SVD>\n", "core/types.hpp only")
        self.red("tests/core/a_test.cpp", "#include <Eigen/Dense>\n", "core/types.hpp")

    def test_decompositions_stay_behind_the_firewall(self):
        for code in ["Eigen::JacobiSVD<Mat3> svd(A);", "Eigen::BDCSVD<MatX> d(A);", "x = A.ldlt().solve(b);",
                     "Eigen::SelfAdjointEigenSolver<Mat3> e(A);", "Eigen::ColPivHouseholderQR<MatX> q(A);",
                     "A.llt().solve(b);", "Eigen::LLT<Mat6> c;", "Eigen::PartialPivLU<MatX> lu;", "A.eigenvalues();"]:
            self.red("src/refine/a.cpp", code + "\n", "decompositions belong in")
            self.red("include/plumbline/rig/a.hpp", code + "\n", "decompositions belong in")
            self.green("src/core/linalg_qr.cpp", code + "\n")
        self.green("src/refine/a.cpp", "// unlike JacobiSVD\nint all_values(int LLTs);\n")

    def test_the_library_does_not_print_or_exit(self):
        for code in ["std::cout << 1;", "std::cerr << 1;", 'printf("x");', 'std::fprintf(f, "x");', "exit(1);",
                     "std::abort();", 'fmt::print("x");', 'system("ls");', "std::exit(2);", 'puts("x");']:
            self.red("src/rig/a.cpp", code + "\n", "never prints")
            self.red("include/plumbline/rig/a.hpp", code + "\n", "never prints")
            self.green("apps/a.cpp", code + "\n")
        self.green("src/rig/a.cpp", 'snprintf(b, 4, "x");\nloop.exit(1);\n// std::cout\nf("std::cerr << exit(1)");\n')
        self.green("src/rig/a.cpp", 'auto t = R"(exit(1))";\n')
        self.red("src/rig/a.cpp", "int n = 1'000'000; exit(1); int m = 2'000;\n", "exit")

    def test_unfinished_work(self):
        self.red("src/rig/a.cpp", "// TODO: later\n", "TODO")
        self.red("tests/rig/a_test.cpp", "// FIXME\n", "FIXME")
        self.red("apps/a.cpp", "/* TODO */\n", "TODO")
        self.green("src/rig/a.cpp", "// mastodon\n")

    def test_licence_line(self):
        self.red("src/rig/a.cpp", "int x;\n", "SPDX", spdx=False)
        self.red("tools/a.py", "x = 1\n", "SPDX", spdx=False)
        self.green("tools/a.py", "#!/usr/bin/env python3\n# SPDX-License-Identifier: Apache-2.0\n", spdx=False)

    def test_length(self):
        self.green("src/rig/a.cpp", "int x;\n" * (rules.MAX_LINES - 1))
        self.red("src/rig/a.cpp", "int x;\n" * rules.MAX_LINES, "at most 500")

    def test_include_guard(self):
        self.red("include/plumbline/rig/a.hpp", SPDX + "int x;\n", "#pragma once", spdx=False)

    def test_an_empty_tree_is_not_a_pass(self):
        with tempfile.TemporaryDirectory() as folder:
            self.assertEqual(rules.check_tree(pathlib.Path(folder), LAYERS), ([], 0))


if __name__ == "__main__":
    unittest.main()
