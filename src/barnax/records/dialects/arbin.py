"""Arbin: workbooks and CSV of MITS 4 to 8, and .res by the extra `arbin`.

Names with underscores (older), with blanks (MITS 8), or without units (as published by TRI). An
Arbin tester logs a sample at the end of its interval. Counters run on until the schedule resets
them.
"""

from .dialect import Dialect

ARBIN = Dialect(
    "Arbin",
    marks=(
        "date time & test time & step index & current & voltage",
        "test time & step time & step index & current & voltage & charge capacity",
        "test time(s) & step index & current(a) & voltage(v)",
        "data point & test time & step index & current",
        "test id & data point & test time",
    ),
    names={
        "time": "test time",
        "step time": "step time",
        "date": "date time|datetime",
        "current": "current",
        "voltage": "voltage",
        "temperature": "aux temperature|aux temperature 1|temperature|temperature 1|temp",
        "step": "step index",
        "cycle": "cycle index",
        "charging capacity": "charge capacity",
        "discharging capacity": "discharge capacity",
        "net capacity": "capacity",
    },
    logs_at_end=True,
)
