"""Laws of the bed's parameters against phi from a TOML file: at its top, or as [model.laws]."""

from __future__ import annotations

import tomllib
from pathlib import Path

from ..physics.bed_laws import Laws, laws_from
from ..schema import InputError

__all__ = ["EXAMPLE", "Laws", "read_laws"]

EXAMPLE = Path(__file__).with_name("example_laws.toml")


def read_laws(file: Path) -> Laws:
    """The laws of a file. InputError with every problem."""
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as e:
        raise InputError([f"--laws {file}: cannot be read ({e.strerror}); name a TOML file"]) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise InputError([f"{file}: is not TOML: {e}"]) from None
    model = table.get("model")
    table = model["laws"] if isinstance(model, dict) and isinstance(model.get("laws"), dict) else table
    laws, problems = laws_from({"source": file.name, **table}, str(file))
    if laws is None:
        raise InputError(problems)
    return laws
