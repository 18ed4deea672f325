# SPDX-License-Identifier: Apache-2.0
"""Every relative link of every Markdown file leads to a file that is there, and every page of docs/ is in its index."""
import pathlib
import re
import sys

root = pathlib.Path(sys.argv[1])
pages = [root / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")] + sorted(root.glob("docs/**/*.md"))
problems, n_links = [], 0
for page in pages:
    for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text()):
        if "://" in link:
            continue
        n_links += 1
        if not (page.parent / link).exists():
            problems.append(f"{page.relative_to(root)}: there is no {link}")
index = (root / "docs/index.md").read_text()
for page in sorted(root.glob("docs/*.md")):
    if page.name != "index.md" and f"({page.name})" not in index:
        problems.append(f"docs/index.md does not list {page.name}")
print("\n".join(problems) or f"{n_links} links of {len(pages)} pages")
sys.exit(bool(problems) or n_links == 0)
