//! Languages of robot controllers, by the names that specifications, requests and files have. The programs themselves are made
//! in [`crate::program::dialects`].

use super::closed_list::closed_list;
use super::closest::did_you_mean;
use super::urdf::{UrdfRemark, joint_3_of_abb};

/// Facts of a dialect that specifications of hardware depend on; all others stand in its file below `program/dialects`.
#[derive(Clone, Copy)]
struct SpecFacts {
    /// True if it belongs to no maker of robots.
    is_neutral: bool,
    /// Remark on a robot from a URDF whose controllers have this language.
    urdf_remark: Option<fn() -> UrdfRemark>,
}

const OF_A_MAKER: SpecFacts = SpecFacts { is_neutral: false, urdf_remark: None };
const OF_NO_MAKER: SpecFacts = SpecFacts { is_neutral: true, ..OF_A_MAKER };

/// The table of dialects, handed to the macro `$reader`. A row: variant, name, file below `program/dialects`, facts for
/// specifications. This room makes the enum of it, `program::dialects` the modules.
macro_rules! dialect_table {
    ($reader:ident) => {
        $reader! {
            /// Commands of Han's CPS interface, one a line.
            Hans = "hans" in hans: OF_A_MAKER;
            /// Universal Robots URScript.
            Urscript = "urscript" in urscript: OF_A_MAKER;
            /// ABB RAPID.
            Rapid = "rapid" in rapid: SpecFacts { urdf_remark: Some(joint_3_of_abb), ..OF_A_MAKER };
            /// KUKA KRL, two files.
            Krl = "krl" in krl: OF_A_MAKER;
            /// FANUC TP, ASCII.
            Fanuc = "fanuc" in fanuc: OF_A_MAKER;
            /// Python for RoboDK, which drives robots of any maker.
            Robodk = "robodk" in robodk: OF_NO_MAKER;
            /// A table of joints and poses, of no maker.
            Csv = "csv" in csv: OF_NO_MAKER;
        }
    };
}

pub(crate) use dialect_table;

/// Makes the enum of the table.
macro_rules! dialect_enum {
    ($($(#[$about:meta])* $dialect:ident = $name:literal in $file:ident: $facts:expr;)*) => {
        closed_list! {
            /// A language of robot controllers.
            pub enum Dialect {$(
                $(#[$about])* $dialect = $name,
            )*}
        }

        impl Dialect {
            fn spec_facts(self) -> SpecFacts {
                match self {
                    $(Self::$dialect => $facts,)*
                }
            }
        }
    };
}

dialect_table!(dialect_enum);

impl Dialect {
    /// Returns true if it belongs to no maker of robots: it suits them all.
    #[must_use]
    pub fn is_neutral(self) -> bool {
        self.spec_facts().is_neutral
    }

    /// Remark on a robot from a URDF whose controllers have this language.
    pub(super) fn urdf_remark(self) -> Option<UrdfRemark> {
        self.spec_facts().urdf_remark.map(|remark| remark())
    }
}

impl std::str::FromStr for Dialect {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|dialect| dialect.as_str() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::as_str);
            format!("unknown dialect {name:?}; known are {}{}", known.join(", "), did_you_mean(name, known))
        })
    }
}
