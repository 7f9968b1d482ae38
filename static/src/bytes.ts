// Meaning of the bytes of `coverage.bin`, as `GET /jobs/{id}/coverage` lists it.
import { causeColour, GRADES, MISSED, NOT_ASKED, type Rgb } from "./palette";

const CAUSES = [
  "excluded_resting", "enclosed", "faces_table", "facing", "depth", "frame_left", "frame_right", "frame_projector", "incidence_left",
  "incidence_right", "incidence_projector", "shadow_left", "shadow_right", "shadow_projector", "below_grade", "unreachable",
  "collision", "hidden_by_cell", "no_path", "not_chosen", "at_risk", "exposure",
];
const FIRST_CAUSE = 16;

/** Grade, cause or `not_asked`, by byte; a job's own list may say otherwise. */
export const meanings = new Map<number, string>([
  ...["A", "B", "C", "D"].map((grade, byte): [number, string] => [byte, grade]),
  ...CAUSES.map((cause, i): [number, string] => [FIRST_CAUSE + i, cause]),
  [255, "not_asked"],
]);

export const meaningOf = (byte: number): string => meanings.get(byte) ?? "not_asked";
export const isGrade = (meaning: string): boolean => meaning.length === 1;
export function colourOf(meaning: string): Rgb {
  return GRADES[meaning] ?? (meaning === "not_asked" ? NOT_ASKED : causeColour(meaning));
}
const colours = Array.from({ length: 256 }, (_, byte) => {
  const meaning = meaningOf(byte);
  return isGrade(meaning) || meaning === "not_asked" ? colourOf(meaning) : MISSED;
});
/** Colour in a picture of grades, which has one for all that is missed. */
export const colourOfByte = (byte: number): Rgb => colours[byte]!;
