"""Neware: BTS 5 to 8, as CSV, workbooks, and the binary files that fastnda reads.

Names as in exports of BTSDA in English and Chinese, and of the library NewareNDA. `Time` and
`Relative Time` start again with each step; older exports have no test clock. The capacity counts
from zero in each step.
"""

from .dialect import Dialect

NEWARE = Dialect(
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
        "date": "unix time|date|absolute time|realtime|real time|system time|date time|timestamp|"
        "系统时间|绝对时间|日期",
        "current": "current|cur|电流",
        "voltage": "voltage|volt|vol|电压",
        "temperature": "temperature|t1|aux1 temperature|温度",
        "step": "step count|step index|step number|step|steps|step id|工步号|工步序号|步次",
        "cycle": "cycle count|cycle index|cycle|cycle id|循环号|循环序号|循环",
        "state": "step type|status|state|step name|step state|工步类型|工步名称|状态",
        "charging capacity": "chg. cap.|charge capacity|cap chg|capacitance chg|充电容量",
        "discharging capacity": "dchg. cap.|discharge capacity|cap dchg|capacitance dchg|放电容量",
        "net capacity": "capacity|cap|容量",
    },
)
