"""Fewest views for a share of the coverable area, and most area with k views, by HiGHS as mixed-integer programs.

Input: a JSON file with `area_mm2` of each sample, `rows` (samples that each candidate measures), `target` (share) and
`views` (k). Output: {"fewest_views", "most_area_mm2"}. One binary a candidate, one continuous variable a sample.
"""

import json
import sys

import highspy
import numpy as np


def solve(table, fewest):
    """The optimum of one of the two programs over x (candidates, binary) and y (samples, 0 to 1): y ≤ sum of x."""
    area = np.array(table["area_mm2"])
    rows = table["rows"]
    seen_by = [[] for _ in area]
    for row, samples in enumerate(rows):
        for sample in samples:
            seen_by[sample].append(row)
    samples = [s for s in range(len(area)) if seen_by[s] and area[s] > 0.0]
    coverable = float(area[samples].sum())

    highs = highspy.Highs()
    highs.silent()
    highs.setOptionValue("mip_rel_gap", 0.0)
    highs.setOptionValue("mip_abs_gap", 1e-6)
    highs.setOptionValue("mip_feasibility_tolerance", 1e-9)
    n, m = len(rows), len(samples)
    for _ in range(n):
        highs.addVar(0.0, 1.0)
    for _ in range(m):
        highs.addVar(0.0, 1.0)
    for x in range(n):
        highs.changeColIntegrality(x, highspy.HighsVarType.kInteger)
        highs.changeColCost(x, 1.0 if fewest else 0.0)
    share = area[samples] / coverable
    for y, sample in enumerate(samples):
        highs.changeColCost(n + y, 0.0 if fewest else -float(share[y]))
        seen = seen_by[sample]
        columns = np.array([n + y, *seen], dtype=np.int32)
        values = np.array([1.0, *([-1.0] * len(seen))])
        highs.addRow(-highspy.kHighsInf, 0.0, len(columns), columns, values)
    if fewest:
        columns = np.arange(n, n + m, dtype=np.int32)
        highs.addRow(table["target"] - 1e-9, highspy.kHighsInf, m, columns, share)
    else:
        columns = np.arange(n, dtype=np.int32)
        highs.addRow(0.0, float(table["views"]), n, columns, np.ones(n))
    highs.run()
    if highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
        raise SystemExit(f"not solved: {highs.getModelStatus()}")
    objective = highs.getInfo().objective_function_value
    return round(objective) if fewest else -objective * coverable


def main():
    """Reads the table and prints both optima."""
    with open(sys.argv[1], encoding="utf-8") as file:
        table = json.load(file)
    print(json.dumps({"fewest_views": solve(table, True), "most_area_mm2": solve(table, False)}))


if __name__ == "__main__":
    main()
