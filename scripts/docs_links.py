"""A hook of mkdocs: links from docs/ to files of the repository work in the site, as they do where the files are read.

A file that a page links to becomes a page of the site under `source/`, with its text highlighted. Nothing is written
outside the site, and nothing is loaded from another host. A link to a file that does not exist is left as it is, so
that the strict build reports it.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.structure.files import File

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent.parent
GUIDES = ("README.md", "CONTRIBUTING.md", "SECURITY.md")
"""Pages outside docs/ that are shown as pages, not as source."""
LANGUAGES = {
    ".py": "python",
    ".sh": "sh",
    ".toml": "toml",
    ".ts": "ts",
    ".tsx": "tsx",
    ".yaml": "yaml",
    ".json": "json",
}

_LINK = re.compile(r'(\]\(|(?:src|href)=")([^)"#:\s]+)(#[^)"\s]*)?(?=[)"])')


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds a page for each file of the repository that a page links to."""
    pages = [ROOT / name for name in GUIDES] + sorted((ROOT / "docs").rglob("*.md"))
    linked = {target for page in pages for target in _targets(page)} | set(GUIDES)
    for path in sorted(linked):
        if not path.startswith("docs/"):
            files.append(File.generated(config, _uri(path), content=_content(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrites the links of a page from places in the repository to places in the site."""
    uri = page.file.src_uri
    source = uri.removeprefix("source/") if uri.startswith("source/") else f"docs/{uri}"

    def rewritten(match: re.Match[str]) -> str:
        start, link, anchor = match.groups()
        target = _resolved(source, link)
        if not (ROOT / target).exists():
            return match[0]
        return start + posixpath.relpath(_uri(target), posixpath.dirname(uri) or ".") + (anchor or "")

    is_guide = source in GUIDES
    return _LINK.sub(rewritten, markdown) if is_guide or source.startswith("docs/") else markdown


def _targets(page: Path) -> set[str]:
    source = page.relative_to(ROOT).as_posix()
    targets = {_resolved(source, match[2]) for match in _LINK.finditer(page.read_text())}
    return {target for target in targets if (ROOT / target).exists()}


def _resolved(source: str, link: str) -> str:
    """The path in the repository that a link of the page `source` means."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), link))


def _uri(path: str) -> str:
    """Where a path of the repository is in the site, as a source file of mkdocs."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    return f"source/{path}" if path in GUIDES else f"source/{path}.md"


def _content(path: str) -> str:
    if path in GUIDES:
        return (ROOT / path).read_text()
    head = f"---\nsearch: {{exclude: true}}\nhide: [toc]\n---\n\n# `{path}`\n\n"
    if (ROOT / path).is_dir():
        names = sorted(child.name for child in (ROOT / path).iterdir() if not child.name.startswith(("_", ".")))
        return head + "\n".join(f"- `{name}`" for name in names) + "\n"
    language = LANGUAGES.get(Path(path).suffix, "text")
    return f'{head}``````{language} linenums="1"\n{(ROOT / path).read_text()}\n``````\n'
