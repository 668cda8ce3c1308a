"""The documentation's site, opened from disk: every link leads somewhere, search answers, pages fit narrow screens."""

from __future__ import annotations

import fcntl
import subprocess
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.console import browser as browsers
from tests.waiting import PATIENCE

pytestmark = [pytest.mark.live, pytest.mark.long]
ROOT = Path(__file__).resolve().parents[1]
SITEMAP = "sitemap.xml"  # the theme asks for it, and a file has no right to read it
QUESTIONS = {
    "sequence numbers": "protocol-header",
    "emergency stop": "protocol-safety",
    "latency timer": "ports",
    "Modbus": "formats",
    "COBS": "protocol-framing",
    "pandas": "recipes",
    "CubeMX": "firmware",
    "recover explicit": "protocol-safety",
    "RS-485": "firmware",
    "wheel Windows": "windows-macos",
}  # what is looked for, and a page that must be among the answers


class Parts(HTMLParser):
    """The links and the anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        self.links += [named[key] or "" for key in ("href", "src") if key in named]
        self.anchors |= {named[key] or "" for key in ("id", "name") if key in named}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site of this process: others may build and read theirs at the same time."""
    out = tmp_path_factory.mktemp("site")
    with (ROOT / "build" / "site.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        subprocess.run(["make", "docs", f"SITE={out}"], cwd=ROOT, check=True, capture_output=True)
    return out


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright, browsers.chromium(playwright, "--allow-file-access-from-files") as started:
        yield started


def test_every_link_leads_to_a_file_and_an_anchor_of_the_site(site: Path) -> None:
    pages = {path: Parts(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    assert len(pages) > 80  # in both languages
    dead = []
    for path, parts in pages.items():
        for link in parts.links:
            to = urlsplit(link)
            if to.scheme or to.netloc or path.name == "404.html":
                continue
            target = (path.parent / unquote(to.path)).resolve() if to.path else path
            is_there = target.is_file() or (target / "index.html").is_file()
            if not is_there or (to.fragment and unquote(to.fragment) not in pages[target].anchors | {"__skip"}):
                dead.append(f"{path.relative_to(site)}: {link}")
    assert dead == []


@pytest.mark.parametrize("language", ["", "zh/"], ids=["English", "Chinese"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 800, 1280])
def test_a_page_fits_its_screen_and_needs_no_network(
    site: Path, browser: Browser, width: int, scheme: str, language: str
) -> None:
    context = browser.new_context(viewport={"width": width, "height": 850}, color_scheme=scheme)  # type: ignore[arg-type]
    page = context.new_page()
    wrong: list[str] = []
    page.on(
        "request",
        lambda request: None if request.url.startswith(("file:", "blob:", "data:")) else wrong.append(request.url),
    )
    page.on("requestfailed", lambda request: None if request.url.endswith(SITEMAP) else wrong.append(request.url))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    for name in ("index", "start-stm32", "console", "protocol-frame"):
        page.goto((site / language / f"{name}.html").as_uri())
        expect(page.locator("article h1").first).to_be_visible()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate("document.body.dataset.mdColorScheme") == {"light": "default", "dark": "slate"}[scheme]
    is_chinese = "十分钟" in page.goto((site / language / "start-stm32.html").as_uri()).text()  # type: ignore[union-attr]
    assert is_chinese == bool(language)
    assert wrong == []
    context.close()


def answers(page: Page, question: str) -> str:
    box = page.locator("input.md-search__input")
    box.fill("")
    box.press_sequentially(question)
    found = page.locator(".md-search-result__item a").first
    expect(found).to_be_attached(timeout=PATIENCE * 1000)
    return " ".join(link.get_attribute("href") or "" for link in page.locator(".md-search-result__item a").all())


def test_search_answers_questions_without_a_network(site: Path, browser: Browser) -> None:
    for question, wanted in QUESTIONS.items():
        page = browser.new_page()
        page.goto((site / "index.html").as_uri())
        assert f"{wanted}.html" in answers(page, question), question
        page.close()
