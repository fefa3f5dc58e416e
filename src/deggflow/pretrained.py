"""Trained fields in a folder or on the Hugging Face Hub: weights, a card for programs, and a card for people.

A folder holds `field.safetensors`, `field.json` (the card as JSON) and `README.md` (the card as the Hub shows it).
Nothing is unpickled, and no code of the repository is run: what the network reads is a function of yours.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax

from .field import MessagePassingField
from .field.features import TIME_FEATURES, TeamFeatures
from .files import StrPath, write_atomically
from .jsonl import InputError, expect_object
from .weights import load_by_card, load_card, save_weights

WEIGHTS = "field.safetensors"
FILES = (WEIGHTS, "field.json", "README.md")
_SIZES = ("node_size", "pair_size", "spread", "width", "rounds", "head_width")


@dataclass(frozen=True)
class ModelCard:
    """What a user has to know of a trained field before using it.

    Attributes:
        name: Of the model.
        summary: What it generates, in a sentence or two.
        data: Where the training data come from, and how many there are.
        seeds: Every seed, by what it decided.
        figures: Measured results by what they measure, with sample sizes: texts or numbers.
        intended_use: What it is for.
        limits: What it was not trained for, and what certificates do not cover.
        licence: SPDX identifier.
        training: Settings of the training run, as JSON values.

    Example:
        >>> card = ModelCard(name="ring", summary="Five agents on a ring.", data="1,000 rings of `rings(0)`.",
        ...                  seeds={"data": 0, "weights": 1}, figures={"validation loss": 0.31},
        ...                  intended_use="The tutorial.", limits="Exactly five agents.")
        >>> print(card.to_markdown().splitlines()[8])
        # ring
    """

    name: str
    summary: str
    data: str
    seeds: Mapping[str, int]
    figures: Mapping[str, str | float]
    intended_use: str
    limits: str
    licence: str = "apache-2.0"
    training: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("name", "summary", "data", "intended_use", "limits", "licence"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value.strip():
                raise ValueError(f"`{name}` must be a text that is not empty; got {value!r}.")

    def to_markdown(self) -> str:
        """The card as Markdown, with the head that the Hub reads."""
        tables = [
            _table(("what", "seed"), self.seeds),
            _table(("measured", "value"), self.figures),
            _table(("setting", "value"), self.training),
        ]
        return _TEMPLATE.format(
            **{**asdict(self), "seeds": tables[0], "figures": tables[1], "training": tables[2]}
        )


_TEMPLATE = """---
library_name: deggflow
license: {licence}
tags:
- flow-matching
- multi-agent
---

# {name}

{summary}

## Intended use

{intended_use}

## Limits

{limits}

## Data

{data}

## Training

{training}

## Seeds

{seeds}

## Figures

{figures}

## How to load it

```python
from deggflow import from_pretrained

field, card = from_pretrained("FOLDER OR ORGANISATION/NAME", featurise)
```

`featurise(z, condition)` gives the features that the network was trained on; it is code, and not part of this folder.
"""


def _table(head: tuple[str, str], rows: Mapping[str, Any]) -> str:
    lines = [f"| {name} | {value} |" for name, value in rows.items()]
    return (
        "\n".join([f"| {head[0]} | {head[1]} |", "|---|---|", *lines]) if lines else "Not stated."
    )


def save_pretrained(
    module: eqx.Module,
    folder: StrPath,
    card: ModelCard,
    *,
    architecture: Mapping[str, Any] | None = None,
) -> None:
    """Writes a trained field into a folder; `hf upload ORGANISATION/NAME FOLDER` publishes it.

    Args:
        module: The field. Arrays are saved; functions and static fields are not.
        folder: Made if there is none; files of an earlier save are replaced.
        card: What users have to know.
        architecture: JSON values from which the field is built again; known of a `MessagePassingField`.

    Raises:
        ValueError: `architecture` is missing for another field, or JSON cannot represent it.
    """
    if architecture is None:
        if not isinstance(module, MessagePassingField):
            raise ValueError(
                "`architecture` must say how to build the field again, as this is no `MessagePassingField` but a "
                f"{type(module).__name__}; {{}} if there is nothing to say."
            )
        architecture = _architecture(module)
    content = {**_plain(card), "architecture": dict(architecture)}
    try:
        content = json.loads(json.dumps(content, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"`architecture` and `card` must be JSON values: {error}.") from None
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    save_weights(folder / WEIGHTS, module, content)
    write_atomically(folder / "README.md", card.to_markdown())


def _plain(card: ModelCard) -> dict[str, Any]:
    return {
        name: dict(value) if isinstance(value, Mapping) else value
        for name, value in vars(card).items()
    }


def from_pretrained(
    source: StrPath,
    featurise: Callable[[Any, Any], TeamFeatures] | None = None,
    *,
    build: Callable[[Mapping[str, Any]], eqx.Module] | None = None,
    revision: str | None = None,
) -> tuple[Any, dict[str, Any]]:
    """Reads a field and its card from a folder, or from the Hub by its repository.

    Args:
        source: A folder, or "organisation/name" if there is no such folder; that needs `deggflow[hub]`. Downloads are
            kept and offline mode (`HF_HUB_OFFLINE=1`) is obeyed, as huggingface_hub does for every library.
        featurise: Features (z, condition) -> `TeamFeatures` that a `MessagePassingField` reads.
        build: For other fields, a function of the card that makes a field of the same structure; its arrays are replaced.
        revision: Branch, tag or commit on the Hub.

    Returns:
        The field, and the card as JSON values.

    Raises:
        InputError: A file is missing, damaged or not of this field; names file and reason.
        ImportError: `source` is no folder, and huggingface_hub is not installed.
        ValueError: Neither or both of `featurise` and `build` are given.

    Example:
        >>> save_pretrained(trained, folder, card)
        >>> again, read = from_pretrained(folder, featurise)
        >>> eqx.tree_equal(trained, again), read["name"]
        (Array(True, dtype=bool), 'ring')
    """
    if (featurise is None) == (build is None):
        raise ValueError("pass one of `featurise` and `build`.")
    folder = Path(source) if Path(source).is_dir() else _download(str(source), revision)
    path = folder / WEIGHTS
    skeleton = build or partial(_skeleton, featurise=featurise)
    return load_by_card(path, skeleton), load_card(path)


def _download(name: str, revision: str | None) -> Path:
    if name.count("/") != 1 or name.startswith(("/", ".")):
        raise InputError("is no folder, and no repository of the form organisation/name", file=name)
    try:
        from huggingface_hub import snapshot_download
    except ModuleNotFoundError as error:
        raise ImportError(
            f"{name!r} is no folder; to download it, pip install 'deggflow[hub]'"
        ) from error
    return Path(snapshot_download(name, revision=revision, allow_patterns=list(FILES)))


def _architecture(module: MessagePassingField) -> dict[str, Any]:
    spread = list(module.spread)
    width = module.embed.out_features
    return {
        "node_size": int(module.embed.in_features) - len(spread) - TIME_FEATURES,
        "pair_size": module.rounds[0].pair.in_features if module.rounds else 1,
        "spread": spread,
        "width": width,
        "rounds": len(module.rounds),
        "head_width": module.head.width_size,
    }


def _skeleton(card: Mapping[str, Any], *, featurise: Any) -> MessagePassingField:
    sizes = dict(expect_object(card.get("architecture"), "architecture", _SIZES, _SIZES))
    spread = sizes.pop("spread")
    if not _positive(spread):
        raise InputError(f"must be positive numbers; got {spread!r}", field="architecture.spread")
    for name, size in sizes.items():
        if not isinstance(size, int) or isinstance(size, bool) or not 0 <= size <= 65_536:
            raise InputError(f"must be a size; got {size!r}", field=f"architecture.{name}")
    return eqx.filter_eval_shape(
        lambda key: MessagePassingField(featurise, spread=tuple(spread), key=key, **sizes),
        jax.random.key(0),
    )


def _positive(spread: Any) -> bool:
    return (
        isinstance(spread, Sequence)
        and bool(spread)
        and all(isinstance(each, int | float) and each > 0 for each in spread)
    )
