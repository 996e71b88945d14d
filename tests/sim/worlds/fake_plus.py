"""The table of fake_table.py with variants of LIBERO-Plus: under a new layout, cube and ball stand elsewhere."""

import sys

from fake_table import FakeTable

from betterbench.sim.worlds.simulator_loop import answer_requests
from betterbench.tasks.worlds.libero_plus import read_variant

ENDINGS = (
    *(f"_view_{around}_0_100_0_0_initstate_0" for around in (2, 10, 20, 40)),
    "_view_0_0_100_0_0_initstate_5",
    "_view_0_0_100_0_0_initstate_0_noise_12",
    "_language_3_view_0_0_100_0_0_initstate_0",
    "_level1_sample1",
    "_add_4",
    "_light_1",
    "_table_2",
)
LACKING = ("_add_4", "_light_1", "_table_2")


class FakePlus(FakeTable):
    def suite(self, name):
        if not name.startswith("libero_plus_"):
            return super().suite(name)
        said = super().suite("libero_object")
        tasks = []
        for number, task in enumerate(said["tasks"]):
            for ending in ENDINGS:
                variant = f"task_{number}{ending}"
                own = "shift the thing" if "_language_" in variant else task["instruction"]
                tasks.append(
                    {
                        "task": number,
                        "name": variant,
                        "instruction": own,
                        "published": variant.replace("_", " "),
                        "states": 1 if "_level" in variant or "_add_" in variant else 50,
                        "bddl_sha256": "1" * 64,
                        "needs": ["scenes/some.xml"] if ending in LACKING else [],
                    }
                )
        return {"tasks": tasks, "versions": {"fake": "1"}}

    def start(self, request):
        if "variant" in request:
            moved = read_variant(request["variant"]).axis == "layout"
            request = {**request, "suite": "libero_object_swap" if moved else "libero_object"}
        return super().start(request)


def main():
    answer_requests(FakePlus(), int(sys.argv[-1]))
