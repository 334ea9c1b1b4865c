"""Check that every link between the project's Markdown files leads somewhere.

    python scripts/check_links.py

Looks at links to files and to headings, in Markdown and in HTML image tags; links to other hosts
are left alone. Prints each dead link and exits with status 1 if there is one.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)[^)]*\)|<(?:img|a)[^>]*(?:src|href)=\"([^\"]+)\"")
CODE = re.compile(r"^(```|~~~).*?^\1|`[^`\n]*`", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#+\s+(.*?)\s*$", re.MULTILINE)


def anchors(text: str) -> set[str]:
    """The anchors that GitHub gives to the headings of a document."""
    found = set()
    for heading in HEADING.findall(re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)):
        words = re.sub(r"[^\w\- ]", "", heading.lower())
        found.add(words.strip().replace(" ", "-"))
    return found


def dead_links(path: Path) -> list[str]:
    """The links of one document that lead nowhere."""
    text = path.read_text(encoding="utf-8")
    dead = []
    for groups in LINK.findall(CODE.sub("", text)):
        link = next(filter(None, groups))
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (path.parent / name) if name else path
        missing = not target.exists()
        if not missing and anchor and target.suffix == ".md":
            missing = anchor not in anchors(target.read_text(encoding="utf-8"))
        if missing:
            dead.append(link)
    return dead


def main() -> int:
    """Check README.md and the like, and everything under docs/."""
    documents = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
    bad = [(path, link) for path in documents for link in dead_links(path)]
    for path, link in bad:
        print(f"{path.relative_to(ROOT)}: dead link {link}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
