# SPDX-License-Identifier: Apache-2.0
"""What a laboratory measures: tables of any format, records, spectra, levels of a sweep."""
