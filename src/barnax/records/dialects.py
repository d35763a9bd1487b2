"""Makes of testers with the names of their columns, as data for `columns`.

A new make is one `Dialect` in `DIALECTS`; the first whose marks a header has is chosen.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

from .quantities import QUANTITIES, Quantity

CHARGE, DISCHARGE = "charge-positive", "discharge-positive"
Sign = Literal["charge-positive", "discharge-positive"]


@dataclass(frozen=True)
class Dialect:
    """The table format of one make.

    `marks` are sets of names ("rec# & amps"): a header with all names of one set is of this make.
    Names are in lower case, with blanks for underscores.

    `names` lists the names of a quantity, from the most to the least specific; for other quantities
    the usual names apply. A unit, in any spelling, may follow a name in the file;
    "programmdauer=ms" gives the unit if none does. `sign` is the make's usual sign of the current;
    with `is_sign_certain` only clear evidence overrules it. `logs_at_end`: a sample's current
    flowed before it. `writes_zero_volts`: 0 V is not a measurement.
    """

    name: str
    marks: tuple[str, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    sign: Sign = CHARGE
    logs_at_end: bool = False
    is_sign_certain: bool = False
    writes_zero_volts: bool = False

    @cached_property
    def quantities(self) -> tuple[Quantity, ...]:
        """The quantities for which this make has names."""
        return tuple(
            replace(quantity, spelled=self.names.get(quantity.name, quantity.spelled))
            for quantity in QUANTITIES
        )

    def is_marked(self, names: set[str]) -> bool:
        """True if the names, each with its unit and without, are of this make."""
        return any(names.issuperset(mark.split(" & ")) for mark in self.marks)


DIALECTS: tuple[Dialect, ...] = (
    Dialect(
        "Battery Data Format",
        marks=(
            "test time / s & current / a & voltage / v",
            "test time second & current ampere & voltage volt",
        ),
    ),
    # Workbooks and CSV of MITS 4 to 8, and .res with the extra `arbin`. Names have underscores
    # (older versions), blanks (MITS 8), or no units (as published by TRI). A sample is logged at
    # the end of its interval. Counters continue until the schedule resets them.
    Dialect(
        "Arbin",
        marks=(
            "date time & test time & step index & current & voltage",
            "test time & step time & step index & current & voltage & charge capacity",
            "test time(s) & step index & current(a) & voltage(v)",
            "data point & test time & step index & current",
            "test id & data point & test time",
        ),
        names={"temperature": "aux temperature|aux temperature 1|temperature|temperature 1|temp"},
        logs_at_end=True,
    ),
    # BTS 5 to 8, as CSV, workbooks, and the binary files that fastnda reads. Names as in exports of
    # BTSDA in English and Chinese, and of the library NewareNDA. `Time` and `Relative Time` restart
    # with each step; older exports have no test clock. The capacity counts from zero in each step.
    Dialect(
        "Neware",
        marks=(
            "datapoint & voltage & current",
            "chg. cap. & dchg. cap.",
            "record id & realtime",
            "record id & step name",
            "record id & step id",
            "index & status & time & timestamp & current(ma)",
            "relative time & absolute time",
            "total time & cycle index & step index & date",
            "total time s & unix time s & step type",
            "record number & relative time",
            "数据序号 & 电流",
            "工步类型 & 电流",
            "工步号 & 电流",
            "步次 & 电流",
            "序号 & 电流 & 电压",
            "总时间 & 电流 & 电压",
            "记录序号 & 电流",
        ),
        names={
            "time": "total time|cumulative time|test time|总时间|累计时间|测试时间",
            "step time": "step time|time|relative time|工步时间|相对时间|时间",
            "date": "unix time|date|absolute time|realtime|real time|system time|date time|"
            "timestamp|系统时间|绝对时间|日期",
            "voltage": "voltage|volt|vol|电压",
            "temperature": "temperature|t1|aux1 temperature|温度",
            "step": "step count|step index|step number|step|steps|step id|工步号|工步序号|步次",
            "cycle": "cycle count|cycle index|cycle|cycle id|循环号|循环序号|循环",
            "state": "step type|status|state|step name|step state|工步类型|工步名称|状态",
            "charging capacity": "chg. cap.|charge capacity|cap chg|capacitance chg|充电容量",
            "discharging capacity": "dchg. cap.|discharge capacity|cap dchg|capacitance dchg|"
            "放电容量",
            "net capacity": "capacity|cap|容量",
        },
    ),
    # Text exports of MIMS (.txt, .csv, or the channel number as suffix). In most of them the
    # current has no sign, and a column with C, D and R gives the direction. The test clock is
    # printed as days and hh:mm:ss ("0d 00:00:05.05"), or as a number with its unit; in exports with
    # German settings a number without a unit is in minutes. Amp-hr counts from zero in each step.
    Dialect(
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
            "cycle": "cyc#|cycle c|cycle|cycle p",
            "net capacity": "amp-hr|mamp-hr=mAh|capacity|cap.",
        },
    ),
    # CSV of Battery Manager and BTS-600, and workbooks with German names. A line of units follows
    # the names ("[V]", "[ss.xxx]"), and the program's clock may begin with an earlier section of
    # the program. German exports print both clocks in milliseconds. The last row, the stop of the
    # program, occurs twice.
    Dialect(
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
            "temperature": "temperature|t1|t batt|logtemppositive|logtemp001|temp1",
            "charging capacity": "ahcha|ahlad",
            "discharging capacity": "ahdch|ahela",
            "net capacity": "ahaccu|ahakku|capacity",
        },
    ),
    # The header line begins with a tilde, as do the lines above it. "Ah" is the net charge.
    Dialect(
        "Basytec",
        marks=("time & t-step & u & i", "time & dataset & u & i", "t-step & ah-step"),
        names={
            "temperature": "t1",
            "step time": "t-step",
            "step": "line",
            "cycle": "cyc-count",
            "state": "command",
            "net capacity": "ah",
        },
    ),
    # [Summary], [Protocol] and [Data]; both clocks are in hours.
    Dialect(
        "Novonix",
        marks=("run time & step time & potential", "run time & potential & current"),
        names={
            "time": "run time",
            # Step types are numbers.
            "state": "",
            "step": "step number|step position",
        },
    ),
    Dialect(
        "Landt",
        marks=(
            "测试时间 & 系统时间",
            "过程号 & 电流",
            "testtime & systime",
            "testtime & steptime & current",
            "test time s & step name",
        ),
        names={
            "date": "systime|system time|date time iso string|系统时间",
            "step": "step-index|step index|step|过程号",
            "cycle": "cycle-index|cycle index|cycle",
            "state": "step-state|step name|mode|过程模式",
            "temperature": "auxtemp|temperature 1",
        },
    ),
    # MATLAB structures of McMaster University and the University of Wisconsin (Kollmeyer).
    Dialect(
        "Kollmeyer",
        marks=("time & voltage & current & ah & wh & power",),
        names={"temperature": "battery temp|temperature", "net capacity": "ah"},
    ),
    # Above the names is a summary of the test, with small tables.
    Dialect("PEC", marks=("total time & load on time & step time",), names={"date": "real time"}),
    Dialect(
        "Bitrode",
        marks=("total time & loop counter", "total time & amp-hours & watt-hours"),
        names={"temperature": "temperature a1|temperature", "net capacity": "amp-hours"},
    ),
    # Rows and names begin with a tab, and a line of units follows the names.
    Dialect(
        "Gamry",
        marks=("pt & t & vf & im", "pt & t & vf & i", "t & vf & im"),
        names={"time": "t=s|time", "current": "im|i", "voltage": "vf|vm"},
    ),
    # Text exports of EC-Lab and BT-Lab (.mpt, .txt), and .mpr with the extra `biologic`. Names
    # precede a slash ("Ewe/V", "<I>/mA", "control/V/mA"). The clock counts from the start of the
    # acquisition, so a file that continues another begins late. `dq` is the charge of the interval
    # before the row; galvanostatic techniques store it in place of the current. The voltage is Ewe,
    # because an .mpr has no Ewe-Ece. EC-Lab exports 0 V for an average voltage that was not
    # recorded.
    Dialect(
        "BioLogic",
        marks=(
            "mode & ox",
            "time & ewe",
            "time & ecell",
            "time & ewe-ece",
            "flags & time",
            "mode & error & time",
        ),
        names={
            "charge of the interval": "dq",
            "voltage": "ecell|ewe|ewe-ece|u",
            "state": "",
            "cycle": "cycle number|half cycle",
            "charging capacity": "",
            "discharging capacity": "",
            "net capacity": "(q-qo)|q-qo|q charge/discharge",
        },
        is_sign_certain=True,
        writes_zero_volts=True,
    ),
    # Only the name of the voltage is unique to this make.
    Dialect("PyBaMM", marks=("current [a] & terminal voltage [v]",), sign=DISCHARGE),
    # Ivium and VersaStudio.
    Dialect("Ivium", marks=("time & i & e", "elapsed time & i & e"), names={"voltage": "u|v|e"}),
)
PLAIN = Dialect("plain")

# Tables that are not a record of one cell over time, by their names, and the file to give instead.
OTHER_TABLES: Mapping[str, str] = {
    "schedule file name & start datetime": "Arbin's description of a test",
    "cycle & vstart & vend": "a table of one row a cycle",
    "cycle id & cap chg & cap dchg": "a table of one row a cycle",
    "cycle-index & capc & capd": "a table of one row a cycle",
}
