"""BioLogic: text exports of EC-Lab and BT-Lab (.mpt, .txt), and .mpr by the extra `biologic`.

Names stand before a slash ("Ewe/V", "<I>/mA", "control/V/mA"). The clock runs from the start of
the acquisition, so that a file that goes on from another starts late. `dq` is the charge of the
interval before the row; galvanostatic techniques store it in place of the current.
"""

from .dialect import Dialect

BIOLOGIC = Dialect(
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
        "time": "time",
        "step time": "step time",
        "current": "i",
        "charge of the interval": "dq",
        "voltage": "ecell|ewe-ece|ewe|u",
        "temperature": "temperature",
        "step": "ns",
        "state": "",
        "cycle": "cycle number|half cycle",
        "charging capacity": "",
        "discharging capacity": "",
        "net capacity": "(q-qo)|q-qo|q charge/discharge",
    },
)
