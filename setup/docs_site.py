"""The hooks of `mkdocs` for this site: pages from outside of docs/, and links to files of the repository.

The site has pages of files that stand elsewhere, such as the changelog. Links to other files of the repository, such as
a header, become their path as text: a site that is opened from disk has no repository beside it.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "protocols/contrib/README.md": "formats.md",
}  # in the repository, and as a page
SHIM = ROOT / "console" / "node_modules" / "iframe-worker" / "shim" / "index.js"
SHIM_ON_SITE = "assets/javascripts/iframe-worker.js"
_LINK = re.compile(r"(?P<bang>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<to>[^)\s]+)\)")


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages from outside of docs/, and the script for search."""
    files.append(File.generated(config, SHIM_ON_SITE, content=SHIM.read_text(encoding="utf-8")))
    for source, page in PAGES.items():
        content = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=content))
    return files


def on_page_markdown(markdown: str, *, page: Page, files: Files, **_: object) -> str:
    """Turn the links of the repository into those of the site."""
    source = next((source for source, name in PAGES.items() if name == page.file.src_uri), f"docs/{page.file.src_uri}")
    folder = Path(source).parent

    def site_link(found: re.Match[str]) -> str:
        to, _, anchor = found["to"].partition("#")
        if not to or "://" in to or to.startswith("mailto:"):
            return found[0]
        path = os.path.normpath(folder / to)
        if path in PAGES:
            target = PAGES[path]
        elif path.startswith("docs/") and path.removeprefix("docs/") in files.src_uris:
            target = path.removeprefix("docs/")
        else:
            return found["text"] if found["text"].startswith("`") else f"{found['text']} (`{path}`)"
        behind = f"#{anchor}" if anchor else ""
        return f"{found['bang']}[{found['text']}]({target}{behind})"

    parts = re.split(r"(^```.*?^```$)", markdown, flags=re.MULTILINE | re.DOTALL)
    return "".join(part if part.startswith("```") else _LINK.sub(site_link, part) for part in parts)
