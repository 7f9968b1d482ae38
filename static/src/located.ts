// What an inspection says where its scans do not tell the place of the part.
import type { Inspection } from "./api";
import { count, percent } from "./settings";
import { text } from "./text";

/** Share of the points that must lie on the part (`MIN_PART_SHARE` in `src/inspection/registration/locate.rs`). */
const MIN_PART_SHARE = 0.5;

/** Reason for which the part was not found; null where it was. For results that do not tell it, by the rule of the server (`why_not_found`). */
export function whyNotFound({ not_found: told, inlier_share: share, views }: Inspection["alignment"]): string | null {
  if (told !== undefined) return told;
  const kept = views.map(({ kept_pose: reason }) => reason);
  if (share < MIN_PART_SHARE) return "few_inliers";
  if (kept.some((reason) => reason !== "few_points" && reason !== "few_inliers")) return null;
  return kept.includes("few_points") ? "few_points" : "few_inliers";
}

/** True where the deviation is one of the part: it was found, or its few points are compared where they were stated to be. */
export function hasDeviation({ alignment, deviation }: Inspection): boolean {
  const reason = whyNotFound(alignment);
  return reason === null || (reason === "few_points" && deviation.alignment === "as_placed");
}

/** Sentences on a part that was not found. */
export function lostWords({ alignment }: Inspection): string {
  const { lost } = text.inspections;
  const points = alignment.views.reduce((sum, view) => sum + view.points, 0);
  return (lost[whyNotFound(alignment) ?? ""] ?? lost.few_inliers!)(percent(alignment.inlier_share), count(points));
}
