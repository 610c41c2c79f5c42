# SPDX-License-Identifier: Apache-2.0
"""
A report as one page of HTML: its frame, its pictures, its text made safe, its file.

A page needs no network, no script and no other file. It has the same bytes for the same result.
"""

from __future__ import annotations

from errno import ENOTDIR
from importlib.resources import files
from os import strerror
from pathlib import Path
from typing import Any, NamedTuple
from unicodedata import category

from impact_damper_ros.outputs import write_texts
from impact_damper_ros.parameters.plain import json_text

from .drawing import inline_svg
from .picture import Picture


class Shown(NamedTuple):
    """A picture as the template shows it."""

    svg: str
    title: str
    caption: str
    wide: bool


def on_page(picture: Picture, key: str, where: str) -> Shown:
    """Return a picture for a page; `key` distinguishes its ids from those of others."""
    label = f'{picture.title}, {where}'
    drawn = inline_svg(picture.figure, key, label)
    return Shown(drawn, picture.title, picture.caption, picture.wide)


def _may_stand(character: str) -> bool:
    return character.isprintable() or category(character) == 'Zs' or character in '\n\t'


def _safe(value: Any) -> Any:
    """
    Return a value without control characters.

    Texts of a recording may hold any character. Control characters, such as those that turn the
    direction of writing, and lone surrogates are shown as a replacement character. Pictures are
    not changed.
    """
    if type(value) is not str:
        return value
    return ''.join(c if _may_stand(c) else '\N{REPLACEMENT CHARACTER}' for c in value)


def render(template: str, /, **content: Any) -> str:
    """Return a page from one of the templates."""
    import jinja2

    folder = files('impact_damper_ros.report') / 'template'

    def source(name: str) -> str:
        return (folder / name).read_text('utf-8')

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(source),
        autoescape=True,
        finalize=_safe,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page: str = environment.get_template(template).render(
        **content, style=source('report.css').strip()
    )
    return page.strip() + '\n'


def write_page(directory: Path, page: str, result: object) -> Path:
    """Write report.html, and the result as report.json beside it, both whole or neither."""
    if directory.exists() and not directory.is_dir():
        raise NotADirectoryError(ENOTDIR, strerror(ENOTDIR), str(directory))
    directory.mkdir(parents=True, exist_ok=True)
    write_texts({directory / 'report.json': json_text(result), directory / 'report.html': page})
    return directory / 'report.html'
