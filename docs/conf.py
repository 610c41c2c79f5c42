"""Settings of Sphinx for the documentation: `make docs`, or rosdoc2."""

import os
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

# rosdoc2 executes this file from one of its own, which names it.
_wrapped = re.search(r'^exec\(open\("(.+?)"\)', Path(__file__).read_text(), re.MULTILINE)
ROOT = Path(_wrapped[1] if _wrapped else __file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
# argparse breaks lines by the width of the terminal.
os.environ['COLUMNS'] = '96'

from impact_damper_ros import __version__  # noqa: E402

project = 'impact_damper_ros'
author = 'the impact_damper_ros developers'
copyright = f'2026, {author}'  # noqa: A001 - the name that Sphinx reads
release = version = __version__

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
    'sphinx.ext.viewcode',
    'sphinx-mathjax-offline',
    'sphinx_copybutton',
    'sphinx_design',
    'sphinx_gallery.gen_gallery',
]
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
}

html_theme = 'furo'
html_title = f'Impact damper {release}'
html_show_sourcelink = False
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


def setup(app: Any) -> None:
    """Connect what is done to docstrings and sources."""
    app.connect('autodoc-process-docstring', _keep_bars)
    app.connect('autodoc-skip-member', _is_bare_field)
    app.connect('source-read', _insert_help)
