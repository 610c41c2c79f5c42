"""Settings of Sphinx for the documentation: `make docs`, or rosdoc2."""

import ast
import os
import re
import sys
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import nbformat
import yaml
from docutils import nodes
from sphinx.util import logging

# rosdoc2 executes this file from one of its own, which names it.
_wrapped = re.search(r'^exec\(open\("(.+?)"\)', Path(__file__).read_text(), re.MULTILINE)
ROOT = Path(_wrapped[1] if _wrapped else __file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'docs')]
# argparse breaks lines by the width of the terminal.
os.environ['COLUMNS'] = '96'

from in_browser.build import build  # noqa: E402

from impact_damper_ros import __version__  # noqa: E402

project = 'impact_damper_ros'
author = 'the impact_damper_ros developers'
copyright = f'2026, {author}'  # noqa: A001 - the name that Sphinx reads
release = version = __version__

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.autosummary',
    'sphinx.ext.napoleon',
    'sphinx-mathjax-offline',
    'sphinx_copybutton',
    'sphinx_design',
    'sphinx_gallery.gen_gallery',
]
# Half the time of a build: pages of source code, and the list of all pages beside each of them.
quick = 'quick' in tags  # noqa: F821 - of Sphinx
extensions += [] if quick else ['sphinx.ext.viewcode']
exclude_patterns = ['_build']
root_doc = 'index'
nitpicky = False

myst_enable_extensions = ['dollarmath', 'amsmath', 'colon_fence', 'deflist']
myst_heading_anchors = 4

# Equations have the number of their page in the theory: (3.2).
numfig = True
numfig_secnum_depth = 1
math_numfig = True

autodoc_member_order = 'bysource'
autodoc_typehints = 'none'
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
# The name of a field may be that of several classes.
suppress_warnings = ['ref.python']
python_use_unqualified_type_names = True
add_module_names = False
default_role = 'code'

sphinx_gallery_conf = {
    'examples_dirs': str(ROOT / 'examples' / 'gallery'),
    'gallery_dirs': 'gallery/made',
    'filename_pattern': '/plot_',
    'within_subsection_order': 'FileNameSortKey',
    'download_all_examples': False,
    'min_reported_time': 1e9,
    'remove_config_comments': True,
    'show_signature': False,
    'write_computation_times': False,
    'plot_gallery': not quick,
}

html_theme = 'furo'
html_title = f'Impact damper {release}'
html_show_sourcelink = False
html_static_path = ['static']
html_css_files = ['tables.css']
# Blocks of code have up to 98 columns.
_code = {'code-font-size': '0.75rem'}
html_theme_options = {'light_css_variables': _code, 'dark_css_variables': _code}
# Prompts are no part of what is copied.
copybutton_prompt_text = r'>>> |\.\.\. |\$ '
copybutton_prompt_is_regexp = True


def _keep_bars(*arguments: Any) -> None:
    """Let |X| in a docstring be what it says; reStructuredText takes it for a substitution."""
    lines = arguments[-1]
    lines[:] = [re.sub(r'\|(\S[^|`]*?)\|', r'\\|\1\\|', line) for line in lines]


def _is_bare_field(*arguments: Any) -> bool | None:
    """Leave out fields of named tuples; the docstring of the class describes them."""
    member = arguments[3]
    return True if str(member.__doc__).startswith('Alias for field number') else None


def _help(match: re.Match[str]) -> str:
    """Return what a command prints with --help, as a block of Markdown."""
    parser = import_module(f'impact_damper_ros.cli.{match[1]}')._parser()
    return f'```text\n{parser.format_help()}```'


def _insert_help(_app: Any, _name: str, source: list[str]) -> None:
    """Put the help of a command in place of each line `{help} NAME`."""
    source[0] = re.sub(r'^\{help\} (\w+)$', _help, source[0], flags=re.MULTILINE)


def _members(match: re.Match[str]) -> str:
    """Name what a module offers, or the part of it that is made in some rooms, with a table."""
    module, *rooms = match[1].split()
    found = import_module(module)
    # A name that comes from another folder is documented there.
    places = tuple(f'{module}.{room}.' for room in rooms) or f'{module}.'
    listed = {name: getattr(found, name) for name in found.__all__}
    kinds = {
        name: 'class' if isinstance(value, type) else 'function'
        for name, value in listed.items()
        if callable(value) and value.__module__.startswith(places)
    }
    entries = [
        f'.. auto{kind}:: {name}\n' + '   :members:\n' * (kind == 'class')
        for name, kind in kinds.items()
    ]
    table = ['.. autosummary::', '   :nosignatures:', '', *(f'   {name}' for name in kinds), '']
    lines = [f'.. currentmodule:: {module}', '', *table, *entries]
    return '\n'.join(['```{eval-rst}', *lines, '```'])


def _insert_members(_app: Any, _name: str, source: list[str]) -> None:
    """Put the documentation of public names in place of each line `{members} MODULE ROOM ...`."""
    source[0] = re.sub(r'^\{members\} (.+)$', _members, source[0], flags=re.MULTILINE)


def _insert_glossary(_app: Any, name: str, source: list[str]) -> None:
    """Put the words of the page in the browser, with their sentences, in place of `{glossary}`."""
    if name != 'reference/glossary':
        return
    path = ROOT / 'impact_damper_ros' / 'page' / 'static' / 'glossary.js'
    # The object is a Python literal, too.
    literal = re.search(r'TERMS = (\{.*?\n\});', path.read_text(encoding='utf-8'), re.DOTALL)
    terms = ast.literal_eval(literal[1]).values()
    lines = []
    for term, sentence in sorted(terms, key=lambda one: one[0].lower()):
        lines += [term, f'  {sentence}', '']
    source[0] = source[0].replace('{glossary}\n', '\n'.join(['```{glossary}', *lines, '```', '']))


def _insert_links(_app: Any, name: str, source: list[str]) -> None:
    """Put beside each link to a live rig the one to a rig in the reader's browser."""
    up = '../' * name.count('/')
    beside = rf'\g<0> (<a href="{up}try/index.html#\1">in your browser</a>)'
    source[0] = re.sub(r'\]\(http://127\.0\.0\.1:8088/#([^)\s]+)\)', beside, source[0])


def _leave_out_list(*arguments: Any) -> None:
    """Leave out the list of all pages that is beside each page."""
    arguments[3].pop('toctree', None)


def _build_page(app: Any, exception: Exception | None) -> None:
    """Build the page with a rig of its own."""
    if exception is None and app.builder.name == 'html':
        build(Path(app.outdir) / 'try', with_theory=() if quick else None)


SEARCH_WORDS = yaml.safe_load((ROOT / 'docs' / 'search_words.yaml').read_text(encoding='utf-8'))


def _index(_app: Any, name: str, source: list[str]) -> None:
    """Put the words by which a page is searched for into the index, below its title."""
    if name in SEARCH_WORDS:
        words = ', '.join(f'! {word}' for word in SEARCH_WORDS[name])
        entry = f'\\1\n\n```{{index}} {words}\n```\n'
        source[0] = re.sub(r'^(# .*)$', entry, source[0], count=1, flags=re.MULTILINE)


#: Headings of the first column of tables whose rows a search finds by name.
_ROWS = 'parameter', 'topic', 'service', 'act', 'field', 'key', 'entry', 'column'
#: Those whose rows have an anchor.
_NAMES = *_ROWS, 'name', 'table', 'quantity', 'sensor_fault', 'actuator_fault', 'package'


def _anchor_rows(app: Any, document: nodes.document) -> None:
    """Give each row of a table that begins with a name an anchor."""
    objects = app.env.get_domain('std')
    for table in document.findall(nodes.table):
        head, body = table.next_node(nodes.thead), table.next_node(nodes.tbody)
        if head is None or body is None:
            continue
        kind = head.next_node(nodes.entry).astext()
        if kind not in _NAMES:
            continue
        for row in body.findall(nodes.row):
            for name in row.next_node(nodes.entry).findall(nodes.literal):
                anchor = re.sub(r'\W+', '-', name.astext()).strip('-')
                if not anchor or anchor in document.ids:
                    continue
                # The name is a link to itself, to be copied.
                if not isinstance(name.parent, nodes.reference):
                    link = nodes.reference('', '', refuri=f'#{anchor}', internal=True)
                    name.replace_self(link)
                    link += name
                document.ids[anchor] = name
                name['ids'].append(anchor)
                if kind in _ROWS and (kind, name.astext()) not in objects.objects:
                    objects.note_object(kind, name.astext(), anchor)


def _prose(text: str) -> list[nbformat.NotebookNode]:
    """Return a cell of text; links to other pages have no target in a notebook."""
    text = re.sub(r'(?<!!)\[([^\]]+)\]\([^)#]+\.md[^)]*\)', r'\1', text).strip()
    return [nbformat.v4.new_markdown_cell(text)] if text else []


def _code(kind: str, block: str) -> list[nbformat.NotebookNode]:
    """Return the cell of a block of a tutorial; what the block before it prints is left out."""
    file = re.match(r'# (\S+\.(?:py|yaml))\n', block)
    if file:
        block = f'%%writefile {file[1]}\n{block}'
    elif kind == 'bash':
        # A node and a page run on beside the notebook.
        live = re.search(r'^(ros2 (run|launch)|sim_node|rig_page)\b', block, re.MULTILINE)
        block = f'%%bash{" --bg" if live else ""}\n{block}'
    elif kind != 'python':
        return [] if kind == 'text' else _prose(f'```\n{block}```')
    return [nbformat.v4.new_code_cell(block.rstrip())]


def notebook(text: str) -> nbformat.NotebookNode:
    """Return a tutorial as a notebook."""
    cells, end = [], 0
    for match in re.finditer(r'^```(\w+)\n(.*?)^```$', text, re.DOTALL | re.MULTILINE):
        cells += _prose(text[end : match.start()]) + _code(match[1], match[2])
        end = match.end()
    cells += _prose(text[end:])
    for count, cell in enumerate(cells):
        cell['id'] = f'block-{count}'  # the same in each build
    kernel = {'name': 'python3', 'display_name': 'Python 3', 'language': 'python'}
    return nbformat.v4.new_notebook(cells=cells, metadata={'kernelspec': kernel})


def _offer_notebook(app: Any, name: str, source: list[str]) -> None:
    """Write a tutorial as a notebook, and link it below the title of its page."""
    if not name.startswith('tutorials/'):
        return
    path = Path(app.outdir) / 'tutorials' / f'{Path(name).name}.ipynb'
    path.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook(source[0]), path)
    link = f'<a href="{path.name}" download>Download this page as a notebook</a>'
    source[0] = re.sub(r'^(# .*)$', rf'\1\n\n{link}', source[0], count=1, flags=re.M)


class _Page(HTMLParser):
    """What a page of the site refers to, and the anchors that it has."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.targets: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding='utf-8'))

    def handle_starttag(self, _tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if name in ('href', 'src'):
                self.targets.add(value or '')
            elif name == 'id':
                self.anchors.add(value or '')


def _check_targets(app: Any, exception: Exception | None) -> None:
    """Warn of each link and picture of the site that is not there, raw HTML included."""
    if exception or app.builder.name != 'html':
        return
    logger = logging.getLogger(__name__)
    place = Path(app.outdir)
    # Pages of an earlier build may lie beside these.
    names = [f'{name}.html' for name in sorted(app.env.found_docs)]
    pages = {place / name: _Page(place / name) for name in names}
    for path, page in pages.items():
        for target in sorted(page.targets):
            address = urlsplit(target)
            if address.scheme or address.netloc:
                continue
            found = (path.parent / unquote(address.path)).resolve() if address.path else path
            known = pages[found].anchors if found in pages else set()
            if not found.exists() or (found in pages and address.fragment not in {'', *known}):
                logger.warning('%s: no target of %r', path.relative_to(place), target)


def setup(app: Any) -> None:
    """Connect what is done to docstrings, sources and the built site."""
    app.connect('autodoc-process-docstring', _keep_bars)
    app.connect('autodoc-skip-member', _is_bare_field)
    app.connect('source-read', _offer_notebook)
    app.connect('source-read', _insert_help)
    app.connect('source-read', _insert_members)
    app.connect('source-read', _insert_glossary)
    app.connect('source-read', _insert_links)
    app.connect('source-read', _index)
    app.connect('build-finished', _build_page)
    for kind in _ROWS:
        app.add_object_type(kind, kind)
    app.connect('doctree-read', _anchor_rows)
    app.connect('build-finished', _check_targets)
    if quick:
        app.connect('html-page-context', _leave_out_list, priority=400)
