//! Documents of inspections: scans and inspections as resources, the result (`vantage.inspection/1`), its listings and tables, and the
//! sentences in them.

mod alignment;
mod coverage;
mod deviation;
mod document;
mod files;
mod learned;
mod order;
mod rescan;
mod scan;
mod tables;
mod verdicts;

pub use alignment::{AlignmentDocument, RigidSdDocument, ViewAlignmentDocument};
pub use coverage::{
    LossDocument, LossListing, LostSpotDocument, MeasuredCoverageDocument, ViewCoverageDocument, loss_phrase, loss_sentence,
    remedy_words,
};
pub use deviation::{
    DeviationDocument, DeviationSpotDocument, ExcludedSharesDocument, ExtentDocument, HistogramDocument, OffSurfaceDocument,
    OpenPartDocument, RegionDeviationDocument, SIGN_SENTENCE, StatisticsDocument, best_fit_sentence, excluded_sentence,
    measured_region_sentence, undecided_sentences,
};
pub use document::{INSPECTION_SCHEMA, InspectedFiles, InspectionDocument};
pub(crate) use files::ranges;
pub use files::{IngestFindingDocument, RemovedDocument, TakenScanDocument};
pub use learned::{
    DeviceLimitDocument, EstimateDocument, LearnedDocument, OfferedChangeDocument, RateBinDocument, WithheldDocument,
    offer_sentence,
};
pub use order::{InspectionJob, InspectionPage, InspectionRequest, InspectionSelection, InspectionSummary};
pub use rescan::{RateCurveDocument, RescanRequest, RescanState};
pub use scan::{Scan, ScanPage};
pub use tables::{colour_limit_mm, coverage_csv, deviation_colour, deviation_csv, deviation_ply, deviation_step};
pub use verdicts::VerdictCounts;
