"""Maccor: text exports of MIMS (.txt, .csv, or the channel's number as suffix).

The current is without a sign in most exports, and a column of C, D and R tells the direction. The
test clock is printed as days and hh:mm:ss ("0d 00:00:05.05"), or as a number with its unit; where
German settings print it without, it is minutes. Amp-hr counts from zero in each step.
"""

from .dialect import Dialect

MACCOR = Dialect(
    "Maccor",
    marks=(
        "rec# & step & amps",
        "rec# & step & mamps",
        "rec & step & md & current",
        "rec# & step & state",
        "cycle p & cycle c",
        "cyc# & amps",
        "cyc# & mamps",
        "rec# & dpt time",
        "dpt time & current & voltage",
    ),
    names={
        "time": "testtime=min|test time=min|test",
        "step time": "steptime=min|step time=min",
        "date": "dpt time|dpt-time|date time",
        "current": "amps|mamps=mA|current|i",
        "voltage": "volts|mvolts=mV|voltage",
        "temperature": "temp 1|temperature cell|temperature|ev temp|temp",
        "step": "step",
        "cycle": "cyc#|cycle c|cycle|cycle p",
        "state": "state|md|status",
        "net capacity": "amp-hr|mamp-hr=mAh|capacity|cap.",
    },
)
