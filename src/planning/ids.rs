//! Numbers of what planning keeps in lists, a type for each list, so that none can be taken for another.
//!
//! | type | number of | place in |
//! | --- | --- | --- |
//! | [`CandidateId`] | a generated viewpoint, dropped or not | the order of generation; files show it |
//! | [`CandidateIndex`] | a candidate that no filter dropped | [`CandidateSet::remaining`], rows of the visibility matrix, reach |
//! | [`RowIndex`] | a candidate that may be chosen | [`CoverProblem::rows`], a part of the candidates |
//! | [`ViewId`] | a chosen view | [`Plan::views`], [`Outcome::measured_by_view`]; files show it |
//! | [`PoseIndex`] | a pose of the part that may be planned in | the pool that the poses are chosen from |
//! | [`SetupIndex`] | a pose of the part that is planned in | the poses in which candidates are generated |
//! | [`SetupId`] | a setup of the plan | [`Plan::setups`], a part of those poses; files show it |
//! | [`SampleId`] | a sample | [`Surface::sample_mm`], [`Outcome::verdicts`], bits of a [`Row`] |
//! | [`PatchId`] | a patch | [`Surface::patches`] |
//!
//! Candidates and poses have two numbers each: an *index* is a place in a list that planning alone holds, and changes with
//! the list; an *id* leaves planning with the outcome.
//!
//! [`CandidateSet::remaining`]: super::candidates::CandidateSet::remaining
//! [`CoverProblem::rows`]: super::selection::CoverProblem::rows
//! [`Plan::views`]: super::plan::Plan::views
//! [`Plan::setups`]: super::plan::Plan::setups
//! [`Outcome::measured_by_view`]: super::plan::Outcome::measured_by_view
//! [`Outcome::verdicts`]: super::plan::Outcome::verdicts
//! [`Surface::sample_mm`]: super::surface::Surface::sample_mm
//! [`Surface::patches`]: super::surface::Surface::patches
//! [`Row`]: super::visibility::Row

macro_rules! numbers {
    ($($(#[$doc:meta])* $name:ident;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u32);

        impl $name {
            /// The number of a place in the list.
            #[inline]
            #[must_use]
            pub fn at(index: usize) -> Self {
                Self(index as u32)
            }

            /// The place in the list.
            #[inline]
            #[must_use]
            pub fn index(self) -> usize {
                self.0 as usize
            }

            /// The numbers of a list of `count` things, ascending.
            #[inline]
            pub fn first(count: usize) -> impl DoubleEndedIterator<Item = Self> + ExactSizeIterator + Clone {
                (0..count as u32).map(Self)
            }

            /// Things in the order of their list, each with its number.
            #[inline]
            pub fn number<T>(things: impl IntoIterator<Item = T>) -> impl Iterator<Item = (Self, T)> {
                (0..).map(Self).zip(things)
            }
        }
    )*};
}

numbers! {
    /// Number of a candidate as generated, in a job that has several setups the setups' one after another; dropped ones have
    /// one too.
    CandidateId;
    /// Place of a candidate among those that no filter dropped: its row in the visibility matrix.
    CandidateIndex;
    /// Place of a row in a cover problem, which has those of the candidates that may be chosen.
    RowIndex;
    /// Dense number of a chosen view, in the order chosen, from 0.
    ViewId;
    /// Place of a pose of the part among those that may be planned in, of which some are chosen.
    PoseIndex;
    /// Place of a pose of the part among those that are planned in.
    SetupIndex;
    /// Number of a setup of the plan, from 0: of the poses that were planned in, those in which views are taken.
    SetupId;
    /// Dense number of a sample of the surface.
    SampleId;
    /// Dense number of a patch of the surface.
    PatchId;
}
