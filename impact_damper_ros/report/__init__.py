# SPDX-License-Identifier: Apache-2.0
"""
The report of a comparison or a replay: text, JSON, tables, figures and the HTML page.

Names are imported from their modules on first use, so that a command which writes only a table
does not load the rest.
"""

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from .html_report import report_page as report_page, write_report as write_report
    from .replay_report import findings_json as findings_json, findings_text as findings_text
    from .text_report import comparison_text as comparison_text

__all__, __getattr__, __dir__ = lazy_names(__name__, __file__)
