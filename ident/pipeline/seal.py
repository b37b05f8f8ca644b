"""What says that an artefact is whole, and what it was made from: ``OUT/.ident/<name>.json``.

It is removed before anything of the artefact is written and written after all of it, with the sha256 of every
file. What has no seal, or is not as its seal says, is never taken for a result: neither what a killed run
left behind nor what was edited afterwards.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ident.pipeline.files import atomic, plain
from ident.pipeline.hashes import sha256_of
from ident.pipeline.lock import KEPT

_OURS = re.compile(r"[a-z][a-z0-9_]*\.(?:json|yaml)|signals/[a-z][a-z0-9_]*\.parquet|index\.html|run\.rrd")


@dataclass(frozen=True)
class MadeFrom:
    """What decides on an artefact.

    version : of the code; files : what of which run -> sha256
    settings : those that it depends on; needs : artefact that it uses -> digest of what that was made from
    """

    version: str
    files: dict[str, str] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    needs: dict[str, str | None] = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """Hash of all of it."""
        return sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()

    def changes(self, before: MadeFrom) -> str:
        """Say what is not as it was, such as "the logs have changed"."""
        parts = {
            "the code": self.version != before.version,
            "the logs or what applies to them": self.files != before.files,
            "the settings": self.settings != before.settings,
            **{name: digest != before.needs.get(name) for name, digest in self.needs.items()},
        }
        changed = [name for name, differs in parts.items() if differs]
        return f"{' and '.join(changed)} changed" if changed else "nothing changed"


@dataclass(frozen=True)
class Seal:
    """What is known of one artefact.

    files : path inside the outputs -> sha256
    data : what it is, where it is no file: its part of the model, a split
    refused : why the data cannot answer, None where they do
    """

    made_from: MadeFrom
    files: dict[str, str] = field(default_factory=dict)
    data: dict[str, Any] | None = None
    refused: str | None = None


_SEAL = TypeAdapter(Seal)


class Seals:
    """The seals of one output folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, name: str) -> Path:
        """Where a seal is kept, whether or not it has been written."""
        return self.folder / KEPT / f"{name}.json"

    def read(self, name: str) -> Seal | None:
        """Read a seal; None where there is none, or something is not as it says."""
        seal = self._said(name)
        return seal if seal is not None and self._is_intact(seal) else None

    def is_broken(self, name: str) -> bool:
        """Whether there is a seal, but what it belongs to was changed or removed since."""
        return self._said(name) is not None and self.read(name) is None

    def remove(self, name: str) -> None:
        """Remove a seal, before what it belongs to is written."""
        self.path(name).unlink(missing_ok=True)

    def write(
        self,
        name: str,
        made_from: MadeFrom,
        *,
        files: Sequence[Path] = (),
        data: Mapping[str, Any] | None = None,
        refused: str | None = None,
    ) -> None:
        """Seal an artefact; its files have been written."""
        hashes = {path.relative_to(self.folder).as_posix(): sha256_of(path) for path in files}
        seal = Seal(made_from, hashes, None if data is None else plain(data), refused)
        with atomic(self.path(name)) as temporary:
            temporary.write_text(json.dumps(plain(seal), ensure_ascii=False, indent=1), encoding="utf-8")

    def digest(self, name: str) -> str | None:
        """Hash of a seal, and so of all that it belongs to; None where that is not whole."""
        return sha256_of(self.path(name)) if self.read(name) is not None else None

    def files(self, name: str) -> list[Path]:
        """List the files that a seal names, changed or not."""
        seal = self._said(name)
        return [] if seal is None else [self.folder / place for place in seal.files]

    def _said(self, name: str) -> Seal | None:
        try:
            seal = _SEAL.validate_json(self.path(name).read_bytes())
        except (OSError, ValidationError):
            return None
        return seal if all(_OURS.fullmatch(place) for place in seal.files) else None

    def _is_intact(self, seal: Seal) -> bool:
        try:
            return all(sha256_of(self.folder / place) == digest for place, digest in seal.files.items())
        except OSError:
            return False
