"""A model file written by hand for the validation: numbers like those of the sample logs, no fit behind."""

from __future__ import annotations

from pathlib import Path

MODEL = """\
schema: ident.model/1
vehicle:
  mass: {value: 12500.0, std: null, unit: kg}
  yaw_inertia: {value: 52000.0, std: 500.0, unit: kg m^2}
  cg_to_front_axle: {value: 2.38, std: null, unit: m}
  cg_to_rear_axle: {value: 2.12, std: null, unit: m}
reference_point: rear_axle
steering:
  gain: {value: 0.986, std: 0.001, unit: "1"}
  dead_time: {value: 0.1173, std: 0.002, unit: s}
  time_constant_1: {value: 0.262, std: 0.003, unit: s}
  time_constant_2: {value: 0.081, std: 0.003, unit: s}
  pair: steering_wheel
  ratio: [[-20.5, -1.0], [20.5, 1.0]]
tyres:
  kind: linear
  front: {cornering_stiffness: {value: 310000.0, std: 3000.0, unit: N/rad}}
  rear: {cornering_stiffness: {value: 400000.0, std: 4000.0, unit: N/rad}}
valid_range: {speed: [3.0, 25.0], lateral_acceleration: [-4.5, 4.5]}
"""
PROVENANCE = "provenance: {improve: {version: '0', command: c, seed: 0, date: d}}\n"


def write_model(folder: Path, text: str = MODEL, more: str = "", *, improved: bool = False) -> Path:
    path = folder / "truck_model.yaml"
    path.write_text(text + more + (PROVENANCE if improved else ""), encoding="utf-8")
    return path
