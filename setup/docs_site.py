"""Write the pages of the documentation's site into build/site-pages, from which mkdocs builds it.

The site has pages of files outside docs/, such as the changelog. Links between them become links of the site. Links to
other files of the repository, such as a header, become their path as text: a site that is opened from disk has no
repository beside it. A link to a Chinese page becomes one to the page, because the site itself chooses the language.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
from pathlib import Path

import site_headers

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "build" / "site-pages"
PAGES = {
    "README.md": "index.md",
    "README.zh.md": "index.zh.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "CODE_OF_CONDUCT.md": "conduct.md",
    "protocols/contrib/README.md": "formats.md",
}  # in the repository, and on the site
SHIM = ROOT / "console" / "node_modules" / "iframe-worker" / "shim" / "index.js"
SHIM_ON_SITE = "assets/javascripts/iframe-worker.js"
LEFT_OUT = ("peers/",)  # of docs/: tables that figures.md names
_LINK = re.compile(r"(?P<bang>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<to>[^)\s]+)\)")
_OTHER_LANGUAGE = re.compile(r" ?\[(?:English|中文)\]\(README(?:\.zh)?\.md\)")
# What a block is to the tests stands after its language, where the generator would not read it: ```yaml mapping.
_KIND = re.compile(r"^(```\w+) .*$", flags=re.MULTILINE)
_CODE = re.compile(r"(^```.*?^```$)", flags=re.MULTILINE | re.DOTALL)


def with_site_links(text: str, source: str, known: set[str]) -> str:
    """Return the page with the site's links.

    :param source: path in the repository.
    :param known: the paths below docs/ that the site has.
    """
    folder = Path(source).parent

    def site_link(found: re.Match[str]) -> str:
        to, _, anchor = found["to"].partition("#")
        if not to or "://" in to or to.startswith("mailto:"):
            return found[0]
        path = os.path.normpath(folder / to)
        if path in PAGES:
            target = PAGES[path]
        elif path.removeprefix("docs/") in known and path.startswith("docs/"):
            target = path.removeprefix("docs/")
        else:
            return found["text"] if found["text"].startswith("`") else f"{found['text']} (`{path}`)"
        fragment = f"#{anchor}" if anchor else ""
        return f"{found['bang']}[{found['text']}]({target.replace('.zh.md', '.md')}{fragment})"

    parts = _CODE.split(_OTHER_LANGUAGE.sub("", text))
    return "".join(_KIND.sub(r"\1", part) if part.startswith("```") else _LINK.sub(site_link, part) for part in parts)


def python_reference() -> str:
    """Return the page of the Python package's public names; mkdocstrings fills it in."""
    module = ast.parse((ROOT / "python" / "src" / "wirebond" / "__init__.py").read_text(encoding="utf-8"))
    (names,) = (
        ast.literal_eval(node.value)
        for node in module.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__"
    )
    functions_first = sorted(names, key=lambda name: (name[0].isupper(), name.endswith("Error"), name))
    parts = "".join(f"::: wirebond.{name}\n\n" for name in functions_first)
    return (
        "# Python names\n\nAfter this page you know each public function and class of `wirebond`, with parameters, "
        f"units and errors. [The Python API](python.md) explains how they work together.\n\n{parts}"
    )


def main() -> None:
    """Write all pages, pictures and the script with which search works from disk."""
    shutil.rmtree(OUT, ignore_errors=True)
    below = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*") if path.is_file()}
    known = {path for path in below if not path.startswith(LEFT_OUT)}
    for source, page in {**PAGES, **{f"docs/{path}": path for path in sorted(known)}}.items():
        to = OUT / page
        to.parent.mkdir(parents=True, exist_ok=True)
        if source.endswith(".md"):
            text = (ROOT / source).read_text(encoding="utf-8")
            to.write_text(with_site_links(text, source, known), encoding="utf-8")
        else:
            shutil.copyfile(ROOT / source, to)
    for page, text in {**site_headers.pages(), "api-python.md": python_reference()}.items():
        (OUT / page).write_text(text, encoding="utf-8")
    (OUT / SHIM_ON_SITE).parent.mkdir(parents=True)
    shutil.copyfile(SHIM, OUT / SHIM_ON_SITE)


if __name__ == "__main__":
    main()
