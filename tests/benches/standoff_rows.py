"""Plans every STL, OBJ and PLY mesh of a folder at four sizes, with and without the default cell, with candidates at the default
stand-off and at the first surface, and writes a row each.

    python standoff_rows.py plan VANTAGE MESHES ROWS.csv [SIZE:CELL ...]
    python standoff_rows.py before OLD_VANTAGE MESHES ROWS.csv [SIZE:CELL ...]
    python standoff_rows.py table ROWS.csv > STANDOFF_ROWS.md

OLD_VANTAGE is the program of 98dd5fe, the release before the slide rule. Rows that a file has already are not planned again. Needs trimesh (tests/oracles/requirements.txt).
"""
import csv
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

# What is set beside the defaults. `first` is the first surface at F with greedy's choice, the experiment that the stand-off was
# judged by; `first_fewest` chooses among the same candidates as the default does.
KINDS = {
    "now": [],
    "first": ["candidates.standoff=first_surface", "selection.solver=greedy"],
    "first_fewest": ["candidates.standoff=first_surface"],
}
# What the release before the slide rule is run with; it has no option that leaves out its report.
BEFORE = "before"
MAX_SECS = 1200
ROOMS = [f"{size}:{cell}" for size in (120, 30, 300, 500) for cell in ("cell", "none")]
COLUMNS = (
    "part size_mm cell kind views candidates idle measured_pct coverable_pct grade_a_pct grade_ab_pct stopped_because cpu_s why"
).split()


def figures(plan):
    """Figures of a plan, in the order of COLUMNS from `views` to `stopped_because`."""
    coverage, candidates = plan["coverage"], plan["candidates"]
    grades = coverage["grades"]
    shares = [coverage["of_asked"], coverage["of_coverable"], grades["A"], grades["A"] + grades["B"]]
    return [
        len(plan["viewpoints"]),
        candidates["kept"],
        candidates["rejected"].get("measures_nothing", 0),
        *(f"{100 * share:.2f}" for share in shares),
        plan["stopped_because"],
    ]


def options(kind, cell):
    """Options of a plan, beside its part and folder."""
    if kind == BEFORE:
        return ["--cell", "none", "--scanner", "transcan-c"] if cell == "none" else []
    fixed = ["--report", "none", "--set", "missed.advice=false"] + (["--cell", "none"] if cell == "none" else [])
    return fixed + [option for setting in KINDS[kind] for option in ("--set", setting)]


def planned(vantage, part, cell, kind, out):
    """Result of one plan on one thread: its figures or why there are none, and seconds of CPU."""
    shutil.rmtree(out, ignore_errors=True)
    command = [vantage, "plan", part, "--unit", "mm", "--out", out, *options(kind, cell)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=MAX_SECS, env={**os.environ, "RAYON_NUM_THREADS": "1"})
        why = (run.stderr.strip().splitlines() or ["no plan"])[-1][:120]
    except subprocess.TimeoutExpired:
        why = f"more than {MAX_SECS // 60} minutes"
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    path = out / "plan.json"
    if path.exists():
        return figures(json.loads(path.read_text())), cpu_s, ""
    return [""] * 8, cpu_s, why


def plan(vantage, meshes, rows, rooms, all_kinds):
    """Plans what `rows` lacks of some kinds."""
    import trimesh

    done = set()
    if os.path.exists(rows):
        with open(rows, newline="") as file:
            done = {tuple(row[key] for key in ("part", "size_mm", "cell", "kind")) for row in csv.DictReader(file)}
    paths = sorted((path for path in Path(meshes).iterdir() if path.suffix in (".stl", ".obj", ".ply")), key=lambda path: path.stat().st_size)
    with open(rows, "a", newline="") as file, tempfile.TemporaryDirectory() as folder:
        writer = csv.writer(file)
        if not done:
            writer.writerow(COLUMNS)
        for size, cell in (room.split(":") for room in rooms or ROOMS):
            for path in paths:
                kinds = [kind for kind in all_kinds if (path.name, size, cell, kind) not in done]
                if not kinds:
                    continue
                mesh = trimesh.load(path, force="mesh", process=False)
                mesh.apply_scale(float(size) / mesh.extents.max())
                part = Path(folder, "part.stl")
                mesh.export(part, file_type="stl")
                for kind in kinds:
                    found, cpu_s, why = planned(vantage, part, cell, kind, Path(folder, "out"))
                    writer.writerow([path.name, size, cell, kind, *found, f"{cpu_s:.1f}", why])
                    file.flush()


def compared(rows, kind):
    """Counts of rows in which the default takes fewer views than `kind`, as many, one more and more, and of grade A and idle ones."""
    pairs = [(row["now"], row[kind]) for row in rows if row.get("now", {}).get("views") and row.get(kind, {}).get("views")]
    more = [int(now["views"]) - int(other["views"]) for now, other in pairs]
    grade_a = [float(now["grade_a_pct"]) - float(other["grade_a_pct"]) for now, other in pairs]
    at_most = sum(number <= 0 for number in more)
    return [
        ("rows", len(pairs)),
        ("fewer views", sum(number < 0 for number in more)),
        ("as many", sum(number == 0 for number in more)),
        ("one more", sum(number == 1 for number in more)),
        ("more than one", sum(number > 1 for number in more)),
        ("as many or fewer", f"{100 * at_most / max(len(pairs), 1):.1f} %"),
        ("views in all, of both", f"{sum(int(now['views']) for now, _ in pairs)}, {sum(int(other['views']) for _, other in pairs)}"),
        ("grade A at most 2 points less", sum(difference >= -2.0 for difference in grade_a)),
        ("grade A, median difference in points", f"{sorted(grade_a)[len(grade_a) // 2]:+.1f}" if grade_a else ""),
        ("seconds of CPU in all, of both", f"{sum(float(now['cpu_s']) for now, _ in pairs):.0f}, {sum(float(other['cpu_s']) for _, other in pairs):.0f}"),
    ]


def idle_share(row):
    """Share of the candidates that measure nothing."""
    idle = int(row["idle"] or 0)
    return idle / max(int(row["candidates"]) + idle, 1)


def entry(row):
    """One entry of the table."""
    if not row or not row["views"]:
        return f"– ({row['why']})" if row else ""
    idle = idle_share(row)
    shown = f" · {100 * idle:.0f} % idle" if idle >= 0.005 else ""
    numbers = [row["views"], *(f"{float(row[key]):.1f}" for key in ("measured_pct", "grade_a_pct", "grade_ab_pct")), f"{float(row['cpu_s']):.0f} s"]
    return " · ".join(numbers) + shown


def table(path):
    """Prints the rows as a page."""
    rows = {}
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            rows.setdefault((row["part"], int(row["size_mm"]), row["cell"]), {})[row["kind"]] = row
    print("# Default plans beside candidates at the first surface, row by row\n")
    print("Written by `tests/benches/standoff_rows.py`: whole plans on one thread, advice and report left out. An entry reads:")
    print("views · measured · at grade A · at A or B, in % of the asked surface · seconds of CPU, beside other work; and the share of")
    print("candidates that measure nothing, where that is half a percent or more. 98dd5fe tells no such share, and its seconds are those with a")
    print("report, which it cannot leave out.\n")
    names = {
        "first": "first surface at F, greedy's choice",
        "first_fewest": "first surface at F, chosen as the default chose at 91d1bbe9",
        BEFORE: "98dd5fe, before the slide rule",
    }
    counts = {kind: compared(rows.values(), kind) for kind in names}
    print("| default against | " + " | ".join(names.values()) + " |")
    print("| --- |" + " --: |" * len(names))
    for index, (what, _) in enumerate(counts["first"]):
        print(f"| {what} | " + " | ".join(str(counts[kind][index][1]) for kind in names) + " |")
    idle = [idle_share(row["now"]) for row in rows.values() if row.get("now", {}).get("views")]
    print(f"\nFewer than 5 % of the candidates measure nothing on {sum(share < 0.05 for share in idle)} of {len(idle)} default plans.\n")
    print("| part | mm | cell | " + " | ".join(["default", *names.values()]) + " |")
    print("| --- | --: | --- | --- |" + " --- |" * len(names))
    for (part, size, cell), kinds in sorted(rows.items()):
        print(f"| `{part}` | {size} | {cell} | " + " | ".join(entry(kinds.get(kind)) for kind in ["now", *names]) + " |")


if __name__ == "__main__":
    if sys.argv[1:2] in (["plan"], ["before"]):
        plan(sys.argv[2], sys.argv[3], sys.argv[4], sys.argv[5:], KINDS if sys.argv[1] == "plan" else [BEFORE])
    elif sys.argv[1:2] == ["table"]:
        table(sys.argv[2])
    else:
        sys.exit(__doc__)
