"""Makes of which a few names tell everything."""

from .dialect import DISCHARGE, Dialect

# The column line begins with a tilde, as the lines above it do. "Ah" is the net charge.
BASYTEC = Dialect(
    "Basytec",
    marks=("time & t-step & u & i", "time & dataset & u & i", "t-step & ah-step"),
    names={
        "time": "time",
        "step time": "t-step",
        "current": "i",
        "voltage": "u",
        "temperature": "t1",
        "step": "line",
        "cycle": "cyc-count",
        "state": "command",
        "charging capacity": "",
        "discharging capacity": "",
        "net capacity": "ah",
    },
)

# [Summary], [Protocol] and [Data]; both clocks are in hours.
NOVONIX = Dialect(
    "Novonix",
    marks=("run time & step time & potential", "run time & potential & current"),
    names={
        "time": "run time",
        "step time": "step time",
        "date": "date and time",
        "voltage": "potential|voltage",
        "temperature": "temperature",
        # Their step types are numbers.
        "state": "",
        "step": "step number|step position",
        "cycle": "cycle number",
        "net capacity": "capacity",
    },
)

LANDT = Dialect(
    "Landt",
    marks=(
        "测试时间 & 系统时间",
        "过程号 & 电流",
        "testtime & systime",
        "testtime & steptime & current",
        "test time s & step name",
    ),
    names={
        "time": "testtime|test time|测试时间",
        "step time": "steptime|step time|过程时间",
        "date": "systime|system time|date time iso string|系统时间",
        "step": "step-index|step index|step|过程号",
        "cycle": "cycle-index|cycle index|cycle",
        "state": "step-state|step name|mode|过程模式",
        "current": "current|电流",
        "voltage": "voltage|电压",
        "temperature": "auxtemp|temperature 1",
        "net capacity": "capacity|容量",
    },
)

# Above the names stands a sheet of the test, with small tables of its own.
PEC = Dialect(
    "PEC",
    marks=("total time & load on time & step time",),
    names={
        "time": "total time",
        "step time": "step time",
        "date": "real time",
        "step": "step",
        "cycle": "cycle",
    },
)

# Rows and names begin with a tab, and a line of units follows the names.
GAMRY = Dialect(
    "Gamry",
    marks=("pt & t & vf & im", "pt & t & vf & i", "t & vf & im"),
    names={"time": "t=s|time", "current": "im|i", "voltage": "vf|vm", "temperature": "temp"},
)

BDF = Dialect(
    "Battery Data Format",
    marks=(
        "test time / s & current / a & voltage / v",
        "test time second & current ampere & voltage volt",
    ),
)
# What the words are in German and Chinese, of no make.
GERMAN = Dialect(
    "German",
    marks=("zeit & strom & spannung", "datum & strom & spannung"),
    names={
        "time": "zeit",
        "date": "datum",
        "current": "strom",
        "voltage": "spannung",
        "temperature": "temperatur",
    },
)
CHINESE = Dialect(
    "Chinese",
    marks=("时间 & 电流 & 电压",),
    names={"time": "时间", "current": "电流", "voltage": "电压", "temperature": "温度"},
)
# Ivium and VersaStudio.
IVIUM = Dialect("Ivium", marks=("time & i & e", "elapsed time & i & e"), names={"voltage": "u|v|e"})

BITRODE = Dialect(
    "Bitrode",
    marks=("total time & loop counter", "total time & amp-hours & watt-hours"),
    names={
        "state": "mode",
        "temperature": "temperature a1|temperature",
        "net capacity": "amp-hours",
    },
)
PYBAMM = Dialect("PyBaMM", marks=("current [a]",), sign=DISCHARGE)
PLAIN = Dialect("plain")
