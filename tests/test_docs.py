"""The pages say for whom they are, and name only files and anchors that exist; the reference is what the code is."""

from __future__ import annotations

import re
import subprocess
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

import pytest

from backend import wire
from backend.agent.acp.extensions import EXTENSIONS
from scripts import reference

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md", *PAGES]
MADE = {"site", "web/dist", "web/node_modules", ".venv"}
"""Folders that a command makes: git does not have them."""
MOST_FILES = 15
"""In a folder of code. docs/architecture.md gives the reason for each that has more."""

_FENCE = re.compile(r"^```.*?^```$", re.M | re.S)
_LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")
_HEADING = re.compile(r"^#{1,6} (.+)$", re.M)
_CODE = re.compile(r"`([^`\n]+)`")
_PATH = re.compile(r"(?:\./)?((?:backend|bench|docs|scripts|tests|web|\.ci)/[\w./*-]*)")
_MODULE = re.compile(r"python -m ((?:backend|bench|scripts|tests)[\w.]*)")
_FILE = re.compile(r"(?:\./)?([\w-]+\.(?:py|tsx?|css|sh|md|toml|lock))\b")
"""A file without its folder, as in a table of the files of one folder."""


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@cache
def tracked() -> frozenset[str]:
    """The files of git, and the new ones that it does not ignore."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    return frozenset(name for name in names if (ROOT / name).is_file())


def anchors(page: Path) -> set[str]:
    """Those of a page's headings, as GitHub makes them."""
    headings = _HEADING.findall(_FENCE.sub("", page.read_text()))
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading) for heading in headings]
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in plain}


def exists(path: str) -> bool:
    """Whether the repository has such a file or folder; `*` stands for any name."""
    path = path.rstrip("/")
    return path in MADE or any(fnmatch(name, path) or name.startswith(path + "/") for name in tracked())


@pytest.mark.parametrize("page", TEXTS, ids=named)
def test_every_path_that_a_page_names_exists(page: Path) -> None:
    text = page.read_text()
    commands = "\n".join(_FENCE.findall(text))
    codes = _CODE.findall(_FENCE.sub("", text))
    paths = [match[1] for word in codes + commands.split() if (match := _PATH.match(word))]
    assert not [path for path in paths if not exists(path)]
    modules = [module.replace(".", "/") for module in _MODULE.findall(text)]
    assert not [module for module in modules if not exists(f"{module}.py") and not exists(f"{module}/__main__.py")]
    names = {name.rpartition("/")[2] for name in tracked()}
    files = [match[1] for code in codes if (match := _FILE.match(code))]
    assert not [file for file in files if file not in names]


@pytest.mark.parametrize("page", TEXTS, ids=named)
def test_every_link_of_a_page_leads_somewhere(page: Path) -> None:
    broken = []
    for link in (markdown or html for markdown, html in _LINK.findall(_FENCE.sub("", page.read_text()))):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert not broken


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_a_page_says_first_for_whom_it_is(page: Path) -> None:
    title, first, *_ = page.read_text().split("\n\n")
    assert re.fullmatch(r"# .+", title)
    assert re.match(r"For (people|everybody) who ", first)


def test_every_page_is_in_the_index_and_in_the_menu_of_the_site() -> None:
    pages = {page.relative_to(DOCS).as_posix() for page in PAGES} - {"index.md"}
    index = {link for link, _ in _LINK.findall((DOCS / "index.md").read_text())}
    assert pages <= index
    menu = re.findall(r"^ +- (?:[^:\n]+: )?(\S+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M)
    assert {page for page in menu if not page.startswith("source/")} == {"index.md"} | pages


def test_the_example_of_the_simulator_runs_as_it_is_written() -> None:
    examples = re.findall(r"^```python\n(.*?)^```$", (DOCS / "simulator.md").read_text(), re.M | re.S)
    assert len(examples) == 1
    exec(examples[0], {})  # noqa: S102 - a page of ours


def test_the_reference_pages_are_what_the_code_is() -> None:
    written = {page.name: page.read_text() for page in reference.FOLDER.glob("*.md")}
    assert written == reference.pages(), "run `python -m scripts.reference`"


def test_every_request_beyond_acp_has_a_section() -> None:
    headings = " ".join(_HEADING.findall((DOCS / "extensions.md").read_text()))
    assert set(re.findall(r"`(_robot/\w+)`", headings)) == {*EXTENSIONS, wire.HEALTH}


def test_a_folder_with_many_files_has_a_reason() -> None:
    folders: dict[str, int] = {}
    for name in tracked():
        folder, _, file = name.rpartition("/")
        is_code = re.match(r"(backend|tests|bench|scripts|web/src)\b", folder) and re.search(
            r"\.(py|tsx?|css|sh)$", file
        )
        if is_code and file != "__init__.py" and not re.search(r"\.test\.tsx?$", file):
            folders[folder] = folders.get(folder, 0) + 1
    assert len(folders) > 20
    large = {folder for folder, count in folders.items() if count > MOST_FILES}
    reasons = set(re.findall(r"^\| `([\w/]+)` \| \w", (DOCS / "architecture.md").read_text(), re.M))
    assert large <= reasons
