//! Points and directions.

use crate::field::Field;
use crate::problem::FieldProblem;
use crate::resolve::Resolver;
use crate::resolve::number::RealRange;
use glam::DVec3;

/// Range of a coordinate: far beyond any map, and far within the numbers that can be squared.
const COORDINATE: RealRange = RealRange::new(-1e12, 1e12);

/// A vector as written.
pub(in crate::resolve) type Triple = Field<[Field<f64>; 3]>;

impl Resolver<'_> {
    /// Resolves the numbers of a list, each within its range.
    pub(in crate::resolve) fn numbers<const N: usize>(
        &self,
        list: &[Field<f64>; N],
        range: RealRange,
    ) -> Option<[f64; N]> {
        let numbers = list.each_ref().map(|number| self.real(number, 0.0, range));
        if numbers.iter().any(Option::is_none) { None } else { Some(numbers.map(Option::unwrap_or_default)) }
    }

    /// Resolves an optional vector, each number within the range; `None` if it is faulty.
    pub(in crate::resolve) fn vector(&self, field: &Triple, range: RealRange) -> Option<Option<DVec3>> {
        field.optional(|field| self.numbers(field.given()?.0, range).map(DVec3::from_array))
    }

    /// Resolves an optional point; `None` if it is faulty.
    pub(in crate::resolve) fn point(&self, field: &Triple) -> Option<Option<DVec3>> {
        self.vector(field, COORDINATE)
    }

    /// Resolves an optional direction; `None` if it is faulty.
    pub(in crate::resolve) fn direction(&self, field: &Triple) -> Option<Option<DVec3>> {
        let direction = self.point(field)?;
        match (direction, field.place()) {
            (Some(DVec3::ZERO), Some(place)) => {
                self.refuse(FieldProblem::of_field("is zero, wanted a direction").at(place))
            }
            _ => Some(direction),
        }
    }
}
