#!/usr/bin/env python3
"""Includes go one way: {rt, config} <- perception <- drivers <- tasks <- tools; within tools from
room to room.

config may include rt; drivers may include of perception only geometry; a haptic device includes no
other one, and tasks include of them drivers/haptic alone; tasks never include each other
(tasks/graph may include all of them, and all may include what they agree on: tasks/contract, which
includes no other folder of tasks); no task includes the simulated world. A part of perception/tsdf
includes the parts that PARTS names. A room of tools includes the rooms that ROOMS names; no room of
the product includes tools/measure, and nothing outside tests includes tests. The table of rooms in
docs/architecture.md says what ROOMS says. Exit 1 and one line for each offence. `--self-test`
proves that offences are seen.
"""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
MAY = {
    "rt": {"rt"},
    "config": {"config", "rt"},
    "perception": {"perception", "rt", "config"},
    "drivers": {"drivers", "perception", "rt", "config"},
    "tasks": {"tasks", "drivers", "perception", "rt", "config"},
}
# Of drivers: what other drivers a haptic device may include. A folder is one by the interface that
# it includes.
OF_DEVICE = {"haptic", "usb"}
DEVICE = '#include "drivers/haptic/haptic_device.hpp"'
# Of tools: a folder, and what it may include besides itself. teletact is the program: nothing
# includes it.
ROOMS = {
    "cli": set(),
    "files": set(),
    "doctor": set(),
    "keys": set(),
    "report": {"files"},
    "scene": {"files"},
    "pictures": {"files"},
    "touch": {"cli", "files"},
    "record": {"files", "scene", "touch"},
    "robot": {"cli", "files", "scene", "record"},
    "offline": {"cli", "files", "record"},
    "host": {"cli", "files", "doctor", "report", "scene", "pictures", "touch", "record"},
    "audit": {"files", "report", "scene", "record", "host"},
    "box": {
        "cli", "files", "doctor", "report", "scene", "pictures", "touch", "record", "host",
        "console", "desk"},
    "bus": {"files"},
    "desk": {"files", "scene", "pictures", "record", "host", "console"},
    "console": set(),
}
ROOMS["teletact"] = set(ROOMS)
ROOMS["measure"] = set(ROOMS) - {"teletact"}
# The page whose table has a line for each room: | `room` | holds | may include |. It may say "all
# above" or "all but ROOM" instead of names.
PAGE = "docs/architecture.md"
ROW = re.compile(r"^\| `(\w+)` \|[^|]*\|([^|]*)\|$", re.M)
# Of perception/tsdf: a part, and what of the others it may include. The map itself owns them all:
# no part includes it.
PARTS = {
    "image": set(),
    "kernels": set(),
    "blocks": {"image", "kernels"},
    "pager": {"image", "blocks"},
    "follow": {"image", "kernels", "blocks"},
    "integrate": {"image", "kernels", "blocks", "pager", "follow"},
    "labels": {"image", "kernels", "blocks"},
    "mesh": {"blocks"},
    "patch": {"blocks"},
}


def haptic_devices(files) -> set:
    """Folders of drivers, from (path, text)."""
    found = {p.split("/")[1] for p, text in files if p.startswith("drivers/") and DEVICE in text}
    return found - {"haptic"}


def offences(path: str, text: str, devices: set):
    top, sub = path.split("/")[:2]
    if path.startswith("tools/cmake/"):
        return  # what is precompiled, for rooms of any kind; no file includes it
    drivers = {"haptic"} if sub == "haptic" else {sub} | OF_DEVICE if sub in devices else None
    part = path.split("/")[2] if re.match("perception/tsdf/[^/]+/", path) else ""
    if top == "tools" and sub not in ROOMS:
        yield f"{path}: tools/{sub} is no room that tools/check_arrows.py knows"
        return
    if part and part not in PARTS:
        yield f"{path}: perception/tsdf/{part} is no part that tools/check_arrows.py knows"
        return
    for line in re.findall(r'^\s*#include "([^"]+)"', text, re.M):
        if line.startswith("tools/cmake/"):
            yield f"{path}: {line} is read by the compiler's command line alone"
        parts = line.split("/")
        if len(parts) < 2:
            continue
        to, to_sub = parts[0], parts[1]
        if top in MAY and to in set(MAY) | {"tools", "tests"} and to not in MAY[top]:
            yield f"{path}: {top} may not include {line}"
        if top == "drivers" and to == "perception" and to_sub != "geometry":
            yield f"{path}: drivers may include of perception only geometry, not {line}"
        if top == to == "drivers" and drivers and to_sub not in drivers:
            yield f"{path}: drivers/{sub} may not include {line}"
        if top == "tasks" and to == "drivers" and to_sub in devices:
            yield f"{path}: a task knows haptic devices by drivers/haptic alone, not by {line}"
        own = sub in ("graph", to_sub)
        if top == "tasks" and to == "tasks" and not own and to_sub != "contract":
            yield f"{path}: tasks do not include each other: {line}"
        if top != "tests" and to == "tests":
            yield f"{path}: nothing outside tests includes {line}"
        if top == "tools" and to == "tools" and to_sub != sub and to_sub not in ROOMS[sub]:
            yield f"{path}: tools/{sub} may not include {line}"
        if part and parts[:2] == ["perception", "tsdf"] and parts[2] not in PARTS[part] | {part}:
            yield f"{path}: perception/tsdf/{part} may not include {line}"
        if top == "tasks" and to == "drivers" and to_sub == "world":
            yield f"{path}: the simulated world is never linked into tasks: {line}"


def table_offences(text: str, rooms: dict):
    """Where the page's table of rooms is not what ROOMS says."""
    table = text[text.find("| room | holds | may include |"):].split("\n\n")[0]
    told = {}
    for room, words in ROW.findall(table):
        left_out = set(re.findall(r"all but (\w+)", words)) | {room}
        named = set(told) if "all above" in words else set(rooms) - left_out
        told[room] = named if "all" in words.split() else set(re.findall(r"\w+", words))
    for room in sorted(set(told) | set(rooms)):
        if room not in rooms:
            yield f"{PAGE}: {room} is no room that tools/check_arrows.py knows"
        elif room not in told:
            yield f"{PAGE}: the table of rooms lacks {room}"
        elif told[room] != rooms[room]:
            missing, extra = sorted(rooms[room] - told[room]), sorted(told[room] - rooms[room])
            yield f"{PAGE}: room {room}: lacks {missing}, has too many {extra}"


def table_missed():
    """Of the self-test: broken tables that pass, and a good one that does not."""
    rooms = {"a": set(), "b": {"a"}, "c": {"a", "b"}, "d": {"a", "b", "c"}, "e": {"a", "b", "c"}}
    head, rows = "| room | holds | may include |\n|---|---|---|\n", [
        "| `a` | x | |\n", "| `b` | x | a |\n", "| `c` | x | a, b |\n", "| `d` | x | all above |\n",
        "| `e` | x | all but d |\n", "\n| `z` | another table | |\n"]
    good = head + "".join(rows)
    bad = [good.replace(rows[1], ""), good.replace("| a, b |", "| a |"),
           good.replace("| x | |", "| x | b |"), good.replace("\n\n", "\n"),
           good.replace(rows[3], "") + rows[3], good.replace("all but d", "all but c"), ""]
    yield from (text for text in bad if not list(table_offences(text, rooms)))
    yield from table_offences(good, rooms)


def main() -> int:
    if "--self-test" in sys.argv:
        bad = [("rt/a/b.hpp", '#include "config/schema.hpp"'),
               ("drivers/x/y.cpp", '#include "perception/tsdf/z.hpp"'),
               ("drivers/falcon/a.hpp", '#include "drivers/omega/b.hpp"'),
               ("drivers/haptic/a.hpp", '#include "drivers/mouse/b.hpp"'),
               ("tasks/haptic/a.cpp", '#include "drivers/omega/omega_twin.hpp"'),
               ("tasks/haptic/a.cpp", '#include "tasks/fusion/b.hpp"'),
               ("tasks/haptic/a.cpp", '#include "tasks/graph/limits.hpp"'),
               ("tasks/contract/a.hpp", '#include "tasks/graph/limits.hpp"'),
               ("tasks/edges/a.hpp", '#include "tasks/haptic/haptic_task.hpp"'),
               ("tasks/graph/a.cpp", '#include "drivers/world/w.hpp"'),
               ("tools/host/a.cpp", '#include "tools/measure/bench/b.hpp"'),
               ("tools/files/a.cpp", '#include "tools/host/b.hpp"'),
               ("tools/measure/a.cpp", '#include "tests/support/b.hpp"'),
               ("tools/measure/a.cpp", '#include "tools/teletact/b.hpp"'),
               ("perception/tsdf/blocks/a.hpp", '#include "perception/tsdf/pager/b.hpp"'),
               ("perception/tsdf/mesh/a.hpp", '#include "perception/tsdf/tsdf_map.hpp"'),
               ("perception/tsdf/attic/a.cpp", ""),
               ("tools/files/a.cpp", '#include "tools/cmake/precompiled.hpp"'),
               ("tools/attic/a.cpp", "")]
        names = ("omega", "falcon", "mouse")
        devices = haptic_devices([*((f"drivers/{name}/{name}.hpp", DEVICE) for name in names),
                                  ("drivers/haptic/stand_in.hpp", DEVICE),
                                  ("tasks/haptic/haptic_task.hpp", DEVICE)])
        missed = [p for p, t in bad if not list(offences(p, t, devices))] + list(table_missed())
        if devices != set(names):
            missed.append(f"haptic devices: {sorted(devices)}")
        allowed = [("tasks/haptic/a.cpp", '#include "tasks/contract/messages.hpp"'),
                   ("drivers/falcon/a.cpp", DEVICE),
                   ("drivers/falcon/a.cpp", '#include "drivers/usb/b.hpp"'),
                   ("drivers/link/a.cpp", '#include "drivers/codec/b.hpp"'),
                   ("tools/measure/a.cpp", '#include "tools/host/b.hpp"'),
                   ("perception/tsdf/tsdf_map.hpp", '#include "perception/tsdf/pager/b.hpp"')]
        good = [wrong for p, t in allowed for wrong in offences(p, t, devices)]
        print("missed:", missed, "wrongly flagged:", good)
        return 1 if missed or good else 0
    files = [(str(f.relative_to(ROOT)), f.read_text()) for top in [*MAY, "tools"]
             for f in sorted((ROOT / top).rglob("*")) if f.suffix in {".hpp", ".cpp", ".inl"}]
    devices = haptic_devices(files)
    found = [wrong for path, text in files for wrong in offences(path, text, devices)]
    found += table_offences((ROOT / PAGE).read_text(), ROOMS)
    print("\n".join(found) if found else "includes: all arrows go one way")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
