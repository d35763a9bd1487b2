"""Digatron: CSV of Battery Manager and BTS-600, and workbooks with German names.

A line of units stands below the names ("[V]", "[ss.xxx]"), and the program's clock may begin with
an earlier section of the program. German exports print both clocks in milliseconds. The last row
is the stop of the program, twice.
"""

from .dialect import Dialect

DIGATRON = Dialect(
    "Digatron",
    marks=(
        "prog time & step time",
        "programmdauer",
        "program time & step time",
        "program duration & step duration",
        "schritt zeit & zeitstempel",
    ),
    names={
        "time": "prog time|program time|program duration|programm zeit|programmdauer=ms",
        "step time": "step time|step duration|schritt zeit|schrittdauer=ms",
        "date": "time stamp|timestamp|zeitstempel|zeit",
        "current": "current|strom",
        "voltage": "voltage|spannung",
        "temperature": "temperature|t1|t batt|logtemppositive|logtemp001|temp1",
        "step": "step|schritt|schritt nr.",
        "cycle": "cycle|zyklus",
        "state": "status|zustand",
        "charging capacity": "ahcha|ahlad",
        "discharging capacity": "ahdch|ahela",
        "net capacity": "ahaccu|ahakku|capacity",
    },
)
