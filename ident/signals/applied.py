"""Which channel map and vehicle file apply to a run.

Those that were named come first; else the nearest file in the log's folder or a parent, up to the path
that the user gave (for a log named itself: up to the folder it lies in); else the built-in maps, where
one of them finds anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ident.errors import BadRecipe
from ident.logs import RunPath
from ident.signals.channel_map import ChannelMap, best_map, built_in_maps, read_channel_map
from ident.vehicle import Vehicle, read_vehicle

CHANNELS, VEHICLE = "channels.yaml", "vehicle.yaml"


@dataclass
class AppliedFiles:
    """Reads each file once; what was named is read at once, so that errors show before any log is read."""

    channels: Sequence[Path] | None = None
    vehicle: Path | None = None
    _maps: dict[Path, ChannelMap] = field(default_factory=dict)
    _vehicles: dict[Path, Vehicle] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for path in self.channels or ():
            self._map(path)
        if self.vehicle is not None:
            self._vehicle(self.vehicle)

    def check(self, runs: Sequence[RunPath]) -> None:
        """Read every file that applies to one of these runs; ``BadRecipe`` where one is wrong."""
        for run in runs:
            self.map_for(run, ())
            self.vehicle_for(run)

    def map_for(self, run: RunPath, topics: Sequence[str]) -> tuple[ChannelMap, str]:
        """Return the channel map of a run with these topics, and how it is called in results."""
        if self.channels is not None:
            found = best_map([self._map(path) for path in self.channels], topics)
            return found, Path(found.source).name
        path = nearest_file(run, CHANNELS)
        if path is not None:
            return self._map(path), _relative(path, run)
        found = best_map(built_in_maps(), topics)
        if not found.choose(lambda channel: channel.topic in topics):
            found = ChannelMap("none", {})
        return found, found.source

    def vehicle_for(self, run: RunPath) -> tuple[Vehicle | None, str]:
        """Return the vehicle of a run, None where no file applies, and how the file is called."""
        path = self.vehicle or nearest_file(run, VEHICLE)
        if path is None:
            return None, "none"
        return self._vehicle(path), path.name if self.vehicle else _relative(path, run)

    def _map(self, path: Path) -> ChannelMap:
        if path not in self._maps:
            self._maps[path] = read_channel_map(path)
        return self._maps[path]

    def _vehicle(self, path: Path) -> Vehicle:
        if path not in self._vehicles:
            self._vehicles[path] = read_vehicle(path)
        return self._vehicles[path]


def nearest_file(run: RunPath, name: str) -> Path | None:
    """Find the nearest file of this name in the folder of a log or above, None where there is none."""
    start = run.path if run.path.is_dir() else run.path.parent
    last = run.root.parent if run.root == run.path else run.root
    for folder in (start.absolute(), *start.absolute().parents):
        if (folder / name).is_file():
            return folder / name
        if folder == last.absolute():
            break
    return None


def _relative(path: Path, run: RunPath) -> str:
    """Path from the one that the user gave, so that results do not depend on where the logs lie."""
    root = run.root.parent if run.root == run.path else run.root
    try:
        return str(path.relative_to(root.absolute()))
    except ValueError as error:
        raise BadRecipe(f"{path}: lies outside {root}") from error
