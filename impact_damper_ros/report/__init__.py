# SPDX-License-Identifier: Apache-2.0
"""
The report of a comparison or a replay: text, JSON, tables, figures and the HTML page.

Names are imported from their modules on first use, so that a command which writes only a table
does not load the rest.
"""

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from .html_report import report_page, write_report
    from .replay_report import findings_json, findings_text
    from .text_report import comparison_text
    from .what_if_report import WhatIfReport

__all__ = [
    'WhatIfReport',
    'comparison_text',
    'findings_json',
    'findings_text',
    'report_page',
    'write_report',
]

__getattr__ = lazy_names(
    __name__,
    {
        'html_report': ('report_page', 'write_report'),
        'replay_report': ('findings_json', 'findings_text'),
        'text_report': ('comparison_text',),
        'what_if_report': ('WhatIfReport',),
    },
)
