"""Hold the simulator against measurements, standards and closed forms: `mmw validate` and its page.

Every row is a `Check`: what is computed, the published value with its source, the range that counts as agreement, and,
where it is known not to agree, why and what would mend it. A module of `mmw.validation.checks` holds the rows of one
topic in `CHECKS`.
"""

from mmw.validation.check import Check, Measurement, Reference, Source
from mmw.validation.registry import all_checks
from mmw.validation.run import Result, run_checks

__all__ = ["Check", "Measurement", "Reference", "Result", "Source", "all_checks", "run_checks"]
