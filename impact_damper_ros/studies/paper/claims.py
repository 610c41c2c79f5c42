"""The claims of section 3 and the conclusions of Bapat (1995), compared with computed numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .claim import Claim
from .force_claims import air_claims, optimum_claims
from .frequency_claims import frequency_claims
from .gap_claims import gap_claims
from .response_claims import response_claims
from .series import FIGURES, AngleOptimum, Series
from .theory_claims import agreement_claims, vertical_claims

_JUDGES = {
    '2': gap_claims,
    '3': response_claims,
    '4': frequency_claims,
    '6': air_claims,
}


def claims_of(
    figure: str, results: Mapping[str, Series], optima: Sequence[AngleOptimum]
) -> list[Claim]:
    """Judge the claims about one figure, from all series by name and the optima of Figure 5."""
    if figure == '5':
        return list(optimum_claims(optima))
    own = {name: series for name, series in results.items() if name[0] == figure}
    return list(_JUDGES[figure](own))


def all_claims(results: Mapping[str, Series], optima: Sequence[AngleOptimum]) -> list[Claim]:
    """Judge all claims."""
    by_figure = [claim for figure in FIGURES for claim in claims_of(figure, results, optima)]
    return [*agreement_claims(results), *by_figure, *vertical_claims()]
