"""Import the code of built-in sensors and of the IDM engine, which processes forked from the fork server then share.

A registry imports it when it is first used, which would otherwise take each worker about a second.
"""

import mmw.generation.executors.local_processes
import mmw.generation.live.traffic_processes  # noqa: F401
from mmw.config.sensor_spec import SENSORS
from mmw.config.traffic_engine import ENGINES
from mmw.core.registry import load_reference

_sensors = [SENSORS[name] for name in SENSORS if SENSORS.owner(name) == "mmw"]
for _spec in _sensors:
    for _reference in filter(None, (_spec.simulate, _spec.to_tables, _spec.capture, _spec.start, _spec.warm_up)):
        load_reference(_reference)
load_reference(ENGINES["idm"].simulate)
