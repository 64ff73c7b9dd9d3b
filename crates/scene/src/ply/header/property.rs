//! Elements and properties that a header declares.

use crate::SceneError;
use crate::cursor::ByteCursor;

/// A property's number type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::ply) enum NumberType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl NumberType {
    /// Number of bytes of a value.
    pub(in crate::ply) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(in crate::ply) fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }
}

/// The type of a property.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::ply) enum PropertyKind {
    One(NumberType),
    List { length: NumberType, item: NumberType },
}

#[derive(Debug, Clone)]
pub(in crate::ply) struct PlyProperty {
    pub(in crate::ply) name: String,
    pub(in crate::ply) kind: PropertyKind,
}

#[derive(Debug, Clone)]
pub(in crate::ply) struct PlyElement {
    pub(in crate::ply) name: String,
    pub(in crate::ply) count: usize,
    pub(in crate::ply) properties: Vec<PlyProperty>,
}

impl PlyElement {
    /// Number of bytes of a row, or `None` if rows contain a list and differ.
    pub(in crate::ply) fn stride(&self) -> Option<usize> {
        self.properties
            .iter()
            .map(|p| if let PropertyKind::One(n) = p.kind { Some(n.size()) } else { None })
            .sum()
    }

    /// Number of bytes of a row; an error if rows differ.
    pub(in crate::ply) fn flat_stride(&self, at: &ByteCursor) -> Result<usize, SceneError> {
        let what = format!("a list among the properties of `{}`", self.name);
        self.stride().ok_or_else(|| at.unsupported(what, "remove that property"))
    }

    pub(in crate::ply) fn has(&self, property: &str) -> bool {
        self.properties.iter().any(|p| p.name == property)
    }
}
