"""OUT/run.rrd: what every stage has to show over time, for the Rerun viewer.

Each stage gives a part: its entities below /<stage>, a tab for each of its views, its answer in words. One
part alone has its views as tabs; several have a tab each, that of the stage that was run in front. All is
on one timeline in seconds since the start of each run. The views have a dark ground of their own, so that
the colours (those of the report's dark form) can be read in either theme of the viewer. This is the only
package that imports rerun.
"""

from ident.report.recording.evaluate import evaluate_part
from ident.report.recording.improve import improve_part
from ident.report.recording.parts import Part, recording_id, write_recording
from ident.report.recording.steering import steering_part
from ident.report.recording.tyres import tyres_part
from ident.report.recording.validate import validate_part

__all__ = [
    "Part",
    "evaluate_part",
    "improve_part",
    "recording_id",
    "steering_part",
    "tyres_part",
    "validate_part",
    "write_recording",
]
