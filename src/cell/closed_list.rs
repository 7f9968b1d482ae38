//! Closed lists of names: enums whose variants are written once, with the name that files, answers and the API document have.

/// Declares an enum: `Variant = "name"`, where the name is the variant's in snake case, as serde and the API document have it. Adds `ALL`, every variant in order, and `as_str`, its name.
#[macro_export]
#[doc(hidden)]
macro_rules! closed_list {
    ($(#[$meta:meta])* pub enum $list:ident {$(
        $(#[$variant_meta:meta])* $variant:ident = $name:literal,
    )*}) => {
        $(#[$meta])*
        #[derive(
            Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize, utoipa::ToSchema,
        )]
        #[serde(rename_all = "snake_case")]
        pub enum $list {$(
            $(#[$variant_meta])*
            $variant,
        )*}

        impl $list {
            /// Every value, in order.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$variant),*];

            /// Name in files and answers.
            #[must_use]
            pub fn as_str(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)*
                }
            }
        }
    };
}

pub use closed_list;

#[cfg(test)]
#[expect(unreachable_pub, reason = "lists are public where they are used")]
mod tests {
    closed_list! {
        /// A list.
        pub enum Two {
            /// The first.
            First = "first",
            /// The second, of two words.
            SecondOne = "second_one",
        }
    }

    #[test]
    fn a_value_has_one_name_everywhere() {
        let names = Two::ALL.map(|value| serde_json::to_value(value).expect("a name"));
        assert_eq!(names, Two::ALL.map(|value| serde_json::Value::from(value.as_str())));
        assert_eq!(serde_json::from_str::<Two>("\"second_one\"").expect("a value"), Two::SecondOne);
    }
}
