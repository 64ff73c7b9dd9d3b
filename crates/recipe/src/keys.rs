//! Keys of the schema, read off its types, so that no list of them has to follow the schema.

use super::problem::FieldProblem;
use super::schema::RecipeSchema;
use serde::de::{Deserialize, Deserializer, Visitor};
use serde::forward_to_deserialize_any;
use std::cell::Cell;

/// The keys of a recipe, in the order of the schema.
pub(super) fn recipe_keys() -> &'static [&'static str] {
    let keys = Cell::new(&[] as &[&str]);
    // Only the names are of interest. Nothing is read, so this is always an error.
    drop(RecipeSchema::deserialize(StructFields(&keys)));
    keys.get()
}

/// A deserializer without a value. It notes the fields of the structure that is asked for.
struct StructFields<'k>(&'k Cell<&'static [&'static str]>);

impl<'de> Deserializer<'de> for StructFields<'_> {
    type Error = FieldProblem;

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, FieldProblem> {
        self.0.set(fields);
        self.deserialize_any(visitor)
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, FieldProblem> {
        Err(FieldProblem::new("there is no value"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit
        unit_struct newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_keys_are_those_of_the_schema() {
        let keys = recipe_keys();
        assert_eq!((keys.first(), keys.last()), (Some(&"version"), Some(&"attributes")));
        assert!(keys.contains(&"trajectories") && !keys.contains(&"refine"));
    }
}
