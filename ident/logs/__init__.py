"""LOG FILE -> SAMPLES: one face on all log formats.

``find_runs`` says which runs lie under the paths that were given; ``open_log`` opens one of them, finds
what is damaged, and reads whole columns of the channels that are asked for.
"""

from ident.logs.find import RunPath, find_runs
from ident.logs.open import open_log
from ident.logs.record import Columns, FieldError, Log, Topic

__all__ = ["Columns", "FieldError", "Log", "RunPath", "Topic", "find_runs", "open_log"]
