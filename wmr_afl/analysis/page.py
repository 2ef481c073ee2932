"""Self-contained HTML pages: one look for all, figures inside."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from wmr_afl.errors import WmrError
from wmr_input.whole_files import write_whole

_ENVIRONMENT = Environment(loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined, autoescape=True)


def write_page(template: str, path: Path, **content: Any) -> Path:
    """Write a page; `template` is a file beside this one or below, which extends `page.html.jinja`.

    Raises:
        WmrError: if it cannot be written.
    """
    text = _ENVIRONMENT.get_template(template).render(**content)
    try:
        write_whole(path, text)
    except OSError as error:
        raise WmrError(f"{path}: cannot be written ({error.strerror})", "name a writable folder") from None
    return path


def inline(png: bytes | Path) -> str:
    """A picture, or that of a file, as text for `src="data:image/png;base64,..."`."""
    return base64.b64encode(png if isinstance(png, bytes) else png.read_bytes()).decode("ascii")
