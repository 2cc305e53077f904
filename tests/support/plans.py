"""R-test plans on the machines of `models/`."""

from support.model_files import machine_of
from volid.planning import rtest_static_grid

# machine: spheres that the travels let the tool follow, tool vectors (one per sphere), letter of the layout
CASES = {
    "wCAYXbZt_trunnion": (
        [(60, 20, 30), (-40, 70, 20), (10, -60, 60)],
        [(0, 0, -120), (20, 0, -120), (0, 20, -140)],
        "B",
    ),
    "wCBXbYZt_trunnion": ([(60, 20, 30), (-40, 70, 20), (10, -60, 60)], [(0, 0, -250)] * 3, "B"),
    "wCXbYZBt_swivel_head": (
        [(60, 20, 300), (-40, 70, 300), (10, -60, 320)],
        [(0, 0, -60), (20, 0, -60), (0, 20, -80)],
        "C",
    ),
    "wCbXYZBt_nutating_head": (
        [(60, 20, 200), (-40, 70, 200), (10, -60, 220)],
        [(0, 0, -90), (20, 0, -90), (0, 20, -80)],
        "C",
    ),
    "wCBYbXZt_nutating_table": ([(60, 20, 30), (-40, 70, 20), (10, -60, 60)], [(0, 0, -80)] * 3, "B"),
    "wbXYZCAt_fork_head": ([(1500, 1000, -400)] * 3, [(0, 0, -100), (60, 0, -120), (0, 60, -150)], "A"),
    "wXbYZCBt_fork_head": ([(1200, 800, -300)] * 3, [(0, 0, -100), (60, 0, -120), (0, 60, -150)], "A"),
    "wCbZXYBt_mill_turn": (
        [(60, 20, 400), (-40, 70, 380), (10, -60, 420)],
        [(0, 0, -60), (20, 0, -60), (0, 20, -80)],
        "C",
    ),
    "wAXYbZt_rotary_table": ([(60, 20, 220), (-40, 70, 150), (10, -60, 200)], [(0, 0, -60)] * 3, ""),
    "wBZbXYt_rotary_table": ([(60, 120, 30), (-40, 200, 60), (10, 260, -60)], [(0, 0, -200)] * 3, ""),
}
FIVE = [name for name, (_, _, letter) in CASES.items() if letter]


def grid(name: str, n1: int = 7, n2: int = 5):
    machine = machine_of(name)
    places, tools, _ = CASES[name]
    spheres = {f"P{i + 1}": place for i, place in enumerate(places)}
    return machine, rtest_static_grid(machine, spheres, tools, n1, n2)
