//! The bytes of a glTF file and of those that it names, and the numbers in them.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use base64::{Engine, alphabet::STANDARD, engine};
use rayon::prelude::*;

use super::json::{Accessor, Document};
use crate::scene::{
    error::{Location, SceneError},
    sources::Sources,
    text::{decode, excerpt, file_name, foreign, one_line},
};

/// Accessors without bytes, which are zeros, have so many elements at most, or as many as there are bytes in all buffers:
/// nothing in the file vouches for more.
const MOST_ZEROS: usize = 1 << 16;

/// Reads the JSON of a `.gltf` or of a `.glb`; of the latter the binary chunk too.
pub(super) fn parse<'a>(path: &Path, bytes: &'a [u8]) -> Result<(Document, &'a [u8]), SceneError> {
    let location = Location::file(path);
    let is_binary = bytes.starts_with(b"glTF");
    let (json, binary) =
        if is_binary { chunks(bytes).map_err(|problem| location.refuse(problem))? } else { (bytes, &[][..]) };
    if !is_binary && let Some(what) = foreign(bytes) {
        return Err(location.refuse(format!("not a glTF file but {what}")));
    }
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    let document = serde_json::from_slice(json).map_err(|error| {
        let location = if is_binary { location } else { Location::line(path, error.line().max(1)) };
        location.refuse(format!("{}; export it anew", one_line(&error.to_string())))
    })?;
    Ok((document, binary))
}

/// The JSON and the binary chunk of a `.glb`.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8]), String> {
    const SHORT: &str = "the file ends early; copy or export it anew";
    let word = |at: usize| bytes.get(at..).and_then(|rest| rest.first_chunk()).map(|word| u32::from_le_bytes(*word));
    match word(4) {
        Some(2) => {}
        Some(version) => return Err(format!("binary glTF of version {version}; convert it to 2.0")),
        None => return Err(SHORT.to_owned()),
    }
    let mut at = 12;
    let (mut json, mut binary) = (None, None);
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        let chunk = bytes.get(at + 8..).and_then(|rest| rest.get(..length as usize)).ok_or(SHORT)?;
        match &kind.to_le_bytes() {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            // Extensions may add others.
            _ => {}
        }
        at += 8 + length as usize;
    }
    match json {
        Some(json) => Ok((json, binary.unwrap_or_default())),
        None => Err("no JSON in it; export it anew".to_owned()),
    }
}

/// Where the bytes of a URI are.
pub(super) enum Place {
    File(PathBuf),
    Bytes(Vec<u8>),
}

/// Finds what a URI names, relative to the file that names it.
pub(super) fn resolve(uri: &str, path: &Path, sources: &Sources) -> Result<Place, String> {
    let percent_decoded = |text: &str| percent_encoding::percent_decode_str(text).collect::<Vec<u8>>();
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, data) = data.split_once(',').ok_or("a data URI without data; export it anew")?;
        if !kind.ends_with(";base64") {
            return Ok(Place::Bytes(percent_decoded(data)));
        }
        let lenient = engine::DecodePaddingMode::Indifferent;
        let settings = engine::GeneralPurposeConfig::new().with_decode_padding_mode(lenient);
        let bytes = engine::GeneralPurpose::new(&STANDARD, settings).decode(data);
        return bytes.map(Place::Bytes).map_err(|error| format!("bad base64 in a data URI ({error}); export it anew"));
    }
    if uri.contains("://") {
        return Err(format!("`{}` is no file beside it; download it and name the file", excerpt(uri)));
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    // Some programs write names as they are, per cent signs and all.
    let literal = folder.join(file_name(uri));
    let decoded = folder.join(file_name(&decode(&percent_decoded(uri))));
    Ok(Place::File(if sources.has(&literal) { literal } else { decoded }))
}

/// The buffers of a document.
pub(super) struct Data<'a> {
    pub document: &'a Document,
    buffers: Vec<Cow<'a, [u8]>>,
}

impl<'a> Data<'a> {
    /// Reads all buffers.
    pub fn read(
        path: &Path,
        document: &'a Document,
        binary: &'a [u8],
        sources: &mut Sources,
    ) -> Result<Self, SceneError> {
        let location = Location::file(path);
        let mut buffers = Vec::new();
        for (index, buffer) in document.buffers.iter().enumerate() {
            let bytes = match &buffer.uri {
                None if index == 0 => Cow::Borrowed(binary),
                // Where bytes are wanted of it, it is too short.
                None => Cow::Borrowed(&[][..]),
                Some(uri) => match resolve(uri, path, sources).map_err(|problem| location.refuse(problem))? {
                    Place::Bytes(bytes) => Cow::Owned(bytes),
                    Place::File(file) => Cow::Owned(sources.require(&file, &location)?),
                },
            };
            buffers.push(bytes);
        }
        Ok(Self { document, buffers })
    }

    /// The bytes of a buffer view.
    pub fn view(&self, index: usize) -> Result<&[u8], String> {
        let view =
            self.document.buffer_views.get(index).ok_or_else(|| format!("no buffer view {index}; export it anew"))?;
        let buffer = self.buffers.get(view.buffer).map_or(&[][..], |buffer| buffer);
        let declared = self.document.buffers.get(view.buffer).map_or(0, |buffer| buffer.byte_length);
        let buffer = &buffer[..buffer.len().min(declared)];
        buffer.get(view.byte_offset..).and_then(|rest| rest.get(..view.byte_length)).ok_or_else(|| {
            let (of, has) = (view.buffer, buffer.len());
            format!("buffer view {index} reaches beyond the {has} bytes of buffer {of}; copy or export it anew")
        })
    }

    /// The elements of an accessor, which are to be of one of these kinds.
    pub fn elements(&self, index: usize, kinds: &[&str]) -> Result<Elements<'_>, String> {
        let Some(accessor) = self.document.accessors.get(index) else {
            return Err(format!("no accessor {index}; export it anew"));
        };
        let component = Component::of(accessor.component_type).ok_or_else(|| {
            format!("accessor {index} has the unknown component type {}; export it anew", accessor.component_type)
        })?;
        if !kinds.contains(&&*accessor.kind) {
            let (kind, wanted) = (excerpt(&accessor.kind), kinds.join(" or "));
            return Err(format!("accessor {index} is of {kind}, where {wanted} is needed; export it anew"));
        }
        let width = match &*accessor.kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let elements = self.dense(index, accessor, component, width)?;
        match &accessor.sparse {
            Some(_) => self.with_sparse(index, accessor, elements),
            None => Ok(elements),
        }
    }

    /// An accessor's elements without those that a sparse one replaces.
    fn dense(
        &self,
        index: usize,
        accessor: &Accessor,
        component: Component,
        width: usize,
    ) -> Result<Elements<'_>, String> {
        let count = accessor.count;
        let size = component.size() * width;
        let make =
            |bytes, stride| Elements { bytes, count, stride, width, component, is_normalized: accessor.normalized };
        let Some(view) = accessor.buffer_view else {
            if count > self.buffers.iter().map(|buffer| buffer.len()).sum::<usize>().max(MOST_ZEROS) {
                return Err(format!("accessor {index} has {count} elements and no bytes; give it a buffer view"));
            }
            return Ok(make(Cow::Owned(vec![0; count * size]), size));
        };
        let bytes = self.view(view)?;
        let stride = self.document.buffer_views.get(view).and_then(|view| view.byte_stride).unwrap_or(size);
        if stride < size {
            return Err(format!(
                "buffer view {view} has a stride of {stride} bytes for elements of {size}; export it anew"
            ));
        }
        let bytes = bytes.get(accessor.byte_offset..).unwrap_or_default();
        // Behind the last element nothing need be up to the stride.
        let needed = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
        if needed.is_none_or(|needed| needed > bytes.len()) {
            return Err(format!("accessor {index} reaches beyond buffer view {view}; copy or export it anew"));
        }
        Ok(make(Cow::Borrowed(bytes), stride))
    }

    /// Lays the elements of a sparse accessor over others.
    fn with_sparse<'b>(
        &'b self,
        index: usize,
        accessor: &Accessor,
        base: Elements<'b>,
    ) -> Result<Elements<'b>, String> {
        let Some(sparse) = &accessor.sparse else { return Ok(base) };
        let size = base.component.size() * base.width;
        let part = |view, byte_offset, component_type, kind: &str| Accessor {
            buffer_view: Some(view),
            byte_offset,
            component_type,
            normalized: false,
            count: sparse.count,
            kind: kind.to_owned(),
            sparse: None,
        };
        let of = part(sparse.indices.buffer_view, sparse.indices.byte_offset, sparse.indices.component_type, "SCALAR");
        let unknown = || format!("the sparse indices of accessor {index} are of an unknown type; export it anew");
        let component =
            Component::of(of.component_type).filter(|component| component.is_index()).ok_or_else(unknown)?;
        let places = self.dense(index, &of, component, 1)?;
        let of = part(sparse.values.buffer_view, sparse.values.byte_offset, accessor.component_type, &accessor.kind);
        let values = self.dense(index, &of, base.component, base.width)?;
        let mut bytes = vec![0; base.count * size];
        for element in 0..base.count {
            let from = base.stride * element;
            bytes[size * element..][..size].copy_from_slice(&base.bytes[from..][..size]);
        }
        for element in 0..sparse.count {
            let place = places.value(element, 0) as usize;
            if place >= base.count {
                let count = base.count;
                return Err(format!("accessor {index} replaces element {place} of {count}; export it anew"));
            }
            let from = values.stride * element;
            bytes[size * place..][..size].copy_from_slice(&values.bytes[from..][..size]);
        }
        Ok(Elements { bytes: Cow::Owned(bytes), stride: size, ..base })
    }

    /// The vectors of an accessor.
    pub fn vectors<const N: usize>(&self, index: usize) -> Result<Vec<[f64; N]>, String> {
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"].get(N).copied().unwrap_or("MAT4");
        Ok(self.elements(index, &[kind])?.vectors())
    }
}

/// The type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    fn is_index(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }
}

/// The elements of an accessor: all of them are within the bytes.
pub(super) struct Elements<'a> {
    bytes: Cow<'a, [u8]>,
    pub count: usize,
    stride: usize,
    pub width: usize,
    component: Component,
    is_normalized: bool,
}

impl Elements<'_> {
    /// Takes whole numbers for shares of the largest one, whatever the accessor says.
    pub fn normalized(mut self) -> Self {
        self.is_normalized = true;
        self
    }

    /// Whether its elements may be indices.
    pub fn are_indices(&self) -> bool {
        self.component.is_index() && self.width == 1
    }

    /// A number of an element.
    #[inline]
    pub fn value(&self, element: usize, place: usize) -> f64 {
        let at = element * self.stride + place * self.component.size();
        let scaled = |value: f64, most: f64| if self.is_normalized { (value / most).max(-1.0) } else { value };
        match self.component {
            Component::I8 => scaled(f64::from(i8::from_le_bytes(self.bytes(at))), f64::from(i8::MAX)),
            Component::U8 => scaled(f64::from(u8::from_le_bytes(self.bytes(at))), f64::from(u8::MAX)),
            Component::I16 => scaled(f64::from(i16::from_le_bytes(self.bytes(at))), f64::from(i16::MAX)),
            Component::U16 => scaled(f64::from(u16::from_le_bytes(self.bytes(at))), f64::from(u16::MAX)),
            Component::U32 => f64::from(u32::from_le_bytes(self.bytes(at))),
            Component::F32 => f64::from(f32::from_le_bytes(self.bytes(at))),
        }
    }

    #[inline]
    fn bytes<const SIZE: usize>(&self, at: usize) -> [u8; SIZE] {
        self.bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().unwrap_or([0; SIZE])
    }

    /// All elements, of which the first numbers count.
    pub fn vectors<const N: usize>(&self) -> Vec<[f64; N]> {
        let vector =
            |element| std::array::from_fn(|place| if place < self.width { self.value(element, place) } else { 0.0 });
        (0..self.count).into_par_iter().map(vector).collect()
    }
}
