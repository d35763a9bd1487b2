"""The parts of `result.json` that say how far the answer can be trusted."""

from .result_parts import Count, Part, Volts
from .trust import Assessment, Examination


class EstimatePart(Part):
    """One parameter, in the unit of its name.

    Without errors where it was `held`; `low` and `high` are null where the data leave them open.
    """

    value: float
    held: str | None
    standard_error: float | None
    plain_standard_error: float | None
    inflation: float | None
    degrees_of_freedom: float | None
    low: float | None
    high: float | None


class NoisePart(Part):
    """The noise behind the errors: parts by their correlation time, 0 for the white one."""

    correlation_s: tuple[float, ...]
    sd_v: tuple[float, ...]


class UncertaintyPart(Part):
    """Standard errors and intervals that reckon with correlated errors, beside the plain ones.

    `correlation` is that of the logarithms of the parameters in `free`.
    """

    confidence: float
    words: str
    parameters: dict[str, EstimatePart]
    free: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    noise: NoisePart


class FindingPart(Part):
    """One thing that the data do not determine."""

    kind: str
    parameters: tuple[str, ...]
    text: str


class IdentifiabilityPart(Part):
    """How well the free parameters can be told apart (Brun et al., 2001)."""

    collinearity_index: float
    condition_number: float
    collinear_pairs: tuple[tuple[str, str, float], ...]
    findings: tuple[FindingPart, ...]


class BandPart(Part):
    """Errors of the samples in one band; `share` is of the summed squared error."""

    label: str
    samples: Count
    rmse_v: Volts
    mean_v: float
    share: float


class DiagnosticsPart(Part):
    """How the errors hang together and where they are large."""

    lags_s: tuple[float, ...]
    autocorrelation: tuple[float, ...]
    integrated_time_s: float
    effective_samples: float
    by_soc: tuple[BandPart, ...]
    by_current: tuple[BandPart, ...]
    by_temperature: tuple[BandPart, ...] | None
    words: str


class ProfilePart(Part):
    """The smallest RMSE for values of one parameter, the others refitted."""

    value: float
    values: tuple[float, ...]
    rmse_v: tuple[Volts, ...]
    threshold_v: Volts
    low: float | None
    high: float | None


class ResampledPart(Part):
    """One parameter over the replicates of the block bootstrap."""

    standard_error: float
    low: float
    high: float


class BootstrapPart(Part):
    """Refits to records with resampled errors."""

    block_s: float
    is_cut: bool
    replicates: Count
    converged: Count
    parameters: dict[str, ResampledPart]


class SuggestionPart(Part):
    """A change that was tried, and the error it reaches."""

    name: str
    text: str
    rmse_v: Volts
    added: Count


class ExaminationPart(Part):
    """What `--trust full` adds."""

    profiles: dict[str, ProfilePart]
    bootstrap: BootstrapPart
    suggestions: tuple[SuggestionPart, ...]
    words: str


class TrustPart(Part):
    """How far the answer can be trusted. `examination` is null unless it was asked for."""

    uncertainty: UncertaintyPart
    identifiability: IdentifiabilityPart
    diagnostics: DiagnosticsPart
    examination: ExaminationPart | None


def trust_part(assessment: Assessment, examination: Examination | None) -> TrustPart:
    """An assessment as it is stored."""
    deeper = None if examination is None else examination.to_dict()
    return TrustPart.model_validate(assessment.to_dict() | {"examination": deeper})
