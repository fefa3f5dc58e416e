"""Certificates as a table of pandas. Needs `deggflow[pandas]`."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

from .certificate import Certificate
from .sampling import Samples

if TYPE_CHECKING:
    import pandas


def to_pandas(
    certificates: Samples | Sequence[Certificate], by: Literal["sample", "requirement"] = "sample"
) -> "pandas.DataFrame":
    """One row for each sample, or one for each sample and requirement.

    Args:
        certificates: Of any number of samples, or the samples themselves.
        by: "sample": verdict, draws and steps, with the column "margin of NAME" for each requirement; "requirement":
            margin, reason and what the record says of the requirement (value, limit, excess, active_points, ...).

    Raises:
        ImportError: pandas is not installed.
        ValueError: `by` is neither.

    Example:
        >>> to_pandas(result)[["satisfied", "draws", "margin of apart"]].shape
        (512, 3)
    """
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise ImportError("tables need pandas: pip install 'deggflow[pandas]'") from error
    if by not in ("sample", "requirement"):
        raise ValueError(f'`by` must be "sample" or "requirement"; got {by!r}.')
    many = certificates.certificates if isinstance(certificates, Samples) else certificates
    of_one = _sample if by == "sample" else _requirements
    rows = [row for number, one in enumerate(many) for row in of_one(number, one)]
    return pandas.DataFrame(rows)


def _sample(number: int, certificate: Certificate) -> Iterator[dict[str, Any]]:
    record = certificate.generation
    yield {
        "sample": number,
        "satisfied": certificate.satisfied,
        "min_margin": certificate.min_margin,
        "violation": certificate.violation,
        "draws": certificate.draws,
        "reason": certificate.reason,
        "hypotheses_hold": None if record is None else record.hypotheses_hold,
        "first_failure": None if record is None else record.first_failure,
        "steps": None if record is None else record.steps,
        "refused_steps": None if record is None else record.refused_steps,
        "forced_steps": None if record is None else record.forced_steps,
        "largest_input_norm": None if record is None else record.largest_input_norm,
        **{f"margin of {each.name}": each.margin for each in certificate.verdicts},
    }


def _requirements(number: int, certificate: Certificate) -> Iterator[dict[str, Any]]:
    records = () if certificate.generation is None else certificate.generation.requirements
    of_name = {each.name: each for each in records}
    verdicts = {each.name: each for each in certificate.verdicts}
    for name in {**verdicts, **of_name}:
        verdict, record = verdicts.get(name), of_name.get(name)
        yield {
            "sample": number,
            "requirement": name,
            "margin": None if verdict is None else verdict.margin,
            "reason": None if verdict is None else verdict.reason,
            **({} if record is None else {k: v for k, v in vars(record).items() if k != "name"}),
        }
