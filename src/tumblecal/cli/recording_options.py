"""Options of the commands that read recordings: `recordings.options` declares them, one by one on the command line."""

from typing import Annotated

from cyclopts import Parameter

from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


Recording = Annotated[RecordingOptions, Parameter(name="*")]
Context = Annotated[KnownContext, Parameter(name="*")]
Rest = Annotated[Criterion, Parameter(name="*")]
