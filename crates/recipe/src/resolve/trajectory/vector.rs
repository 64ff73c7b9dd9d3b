//! Points and directions.

use crate::field::Field;
use crate::problem::FieldProblem;
use crate::resolve::Resolver;
use crate::resolve::number::RealRange;
use glam::DVec3;

/// Range of a coordinate: far beyond any map, and far within the numbers that can be squared.
const COORDINATE: RealRange = RealRange::new(-1e12, 1e12);

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

    /// Resolves an optional point; `None` if it is faulty.
    pub(in crate::resolve) fn point(&self, field: &Field<[Field<f64>; 3]>) -> Option<Option<DVec3>> {
        let Some((list, _)) = field.given() else { return field.is_absent().then_some(None) };
        self.numbers(list, COORDINATE).map(|point| Some(DVec3::from_array(point)))
    }

    /// Resolves an optional direction; `None` if it is faulty.
    pub(in crate::resolve) fn direction(&self, field: &Field<[Field<f64>; 3]>) -> Option<Option<DVec3>> {
        let direction = self.point(field)?;
        match (direction, field.place()) {
            (Some(DVec3::ZERO), Some(place)) => {
                self.refuse(FieldProblem::of_field("is zero, wanted a direction").at(place))
            }
            _ => Some(direction),
        }
    }
}
