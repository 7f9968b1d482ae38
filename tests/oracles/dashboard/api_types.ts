// Holds the types that the dashboard writes by hand (`static/src/api.ts`) against those that openapi-typescript makes of
// `api/openapi.json` (`served.ts`): what the server may answer is of the page's type, and the page names no field that the document
// does not have. Nothing runs; a difference is an error of the type checker.
import type * as page from "./api";
import type { components } from "./served";

type Served = components["schemas"];

/** A served value: a field that may be null is there. */
type Whole<T> = T extends readonly unknown[] ? Whole<T[number]>[]
  : T extends object ? { [K in keyof T as null extends T[K] ? K : never]-?: Whole<T[K]> } & { [K in keyof T as null extends T[K] ? never : K]: Whole<T[K]> }
    : T;

/** A type of the page with lists in place of its tuples, since the document does not tell the length of each. */
type Loose<T> = T extends readonly unknown[] ? Loose<T[number]>[] : T extends object ? { [K in keyof T]: Loose<T[K]> } : T;

type FieldsOf<T> = T extends object ? keyof T : never;
type FieldOf<T, K> = T extends object ? (K extends keyof T ? T[K] : never) : never;

/** Paths of fields that a type of the page has and the served one has not. */
type Unserved<Page, Given, Path extends string = ""> = Page extends readonly (infer Item)[]
  ? Unserved<Item, Given extends readonly (infer Other)[] ? Other : never, Path>
  : Page extends object
    ? { [K in keyof Page & string]: string extends keyof Page ? never : K extends FieldsOf<Given>
      ? Unserved<NonNullable<Page[K]>, NonNullable<FieldOf<Given, K>>, `${Path}/${K}`> : `${Path}/${K}` }[keyof Page & string]
    : never;

/** Conversion of a served value that needs no code; the paths of fields that are the page's alone, if there are any. */
type Held<Page, Name extends keyof Served> = [Unserved<Page, Served[Name]>] extends [never]
  ? (given: Whole<Served[Name]>) => Loose<Page> : Unserved<Page, Served[Name]>;

export const asMesh: Held<page.Mesh, "Mesh"> = (given) => given;
export const asMissedGroup: Held<page.MissedGroup, "MissedGroup"> = (given) => given;
export const asSummary: Held<page.Summary, "Summary"> = (given) => given;
export const asRegion: Held<page.Region, "RegionCoverageDocument"> = (given) => given;
export const asJob: Held<page.Job, "Job"> = (given) => given;
export const asDevice: Held<page.Device, "DeviceDocument"> = (given) => given;
export const asScanner: Held<page.Scanner, "ScannerDocument"> = (given) => given;
export const asViewpoint: Held<page.Viewpoint, "ViewpointDocument"> = (given) => given;
export const asRemedy: Held<page.Remedy, "RemedyDocument"> = (given) => given;
export const asSpot: Held<page.Spot, "SpotDocument"> = (given) => given;
export const asMissedListing: Held<page.MissedListing, "MissedListing"> = (given) => given;
export const asPlan: Held<page.Plan, "PlanDocument"> = (given) => given;
export const asStep: Held<page.Step, "StepDocument"> = (given) => given;
export const asProgram: Held<page.Program, "ProgramDocument"> = (given) => given;
export const asShape: Held<page.Shape, "ShapeSpec"> = (given) => given;
export const asBody: Held<page.Body, "BodySpec"> = (given) => given;
export const asLinkBody: Held<page.LinkBody, "LinkBodySpec"> = (given) => given;
export const asRobot: Held<page.Robot, "RobotSpec"> = (given) => given;
export const asTurntable: Held<page.Turntable, "TurntableSpec"> = (given) => given;
export const asScannerSpec: Held<page.ScannerSpec, "ScannerSpec"> = (given) => given;
export const asCell: Held<page.Cell, "CellSpec"> = (given) => given;
export const asRun: Held<page.Run, "Run"> = (given) => given;
export const asRunSample: Held<page.RunSample, "RunSample"> = (given) => given;
export const asStepRecord: Held<page.StepRecord, "RunStepRecord"> = (given) => given;
export const asCalibrationJob: Held<page.CalibrationJob, "CalibrationJob"> = (given) => given;
export const asCalibration: Held<page.Calibration, "CalibrationDocument"> = (given) => given;
export const asScan: Held<page.Scan, "Scan"> = (given) => given;
export const asInspectionJob: Held<page.InspectionJob, "InspectionJob"> = (given) => given;
export const asInspection: Held<page.Inspection, "InspectionDocument"> = (given) => given;
export const asLoss: Held<page.Loss, "LossDocument"> = (given) => given;
export const asLearned: Held<page.Learned, "LearnedDocument"> = (given) => given;
export const asNote: Held<page.Note, "FieldWarning"> = (given) => given;
export const asProblemField: Held<page.ProblemField, "ProblemField"> = (given) => given;
