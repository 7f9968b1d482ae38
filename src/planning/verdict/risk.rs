//! The closed list of reasons for which a real scan may lack what the simulation measures.

use crate::cell::closed_list;

closed_list! {
    /// The reason for which a measured sample is at risk ([`crate::planning::method::realism`]).
    pub enum RiskReason {
        /// Within the zone along a concave edge.
        ConcaveZone = "concave_zone",
        /// Within that zone, and the projector's light is mirrored onto the opposite face in every view that measures it.
        InterReflection = "inter_reflection",
        /// Near the border of a device's image in a view that measures it, and no view measures it clear of both margins.
        FrameMargin = "frame_margin",
        /// Near a jump of depth in a device's image in a view that measures it, and no view measures it clear of both margins.
        SilhouetteMargin = "silhouette_margin",
    }
}
