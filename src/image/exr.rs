//! OpenEXR: three `f32` channels, ZIP compressed, with metadata as text attributes.
//!
//! The `exr` crate keeps custom attributes in a hash map, so it neither writes them in a fixed
//! order nor reports their order in a file: the same image would give different bytes from run to
//! run. This module therefore writes and reads text attributes itself, following the [file layout];
//! the crate writes a placeholder attribute of the same size:
//! magic, version, (name NUL type NUL size value)*, NUL, table of chunk offsets, chunks.
//!
//! [file layout]: https://openexr.com/en/latest/OpenEXRFileLayout.html

use std::io::{self, BufRead, BufReader, BufWriter, Cursor, Read, Seek, SeekFrom, Write};

use exr::{
    image::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image as ExrImage, Layer, SpecificChannels, read,
        write::WritableImage,
    },
    math::Vec2,
    meta::{
        MetaData,
        attribute::{AttributeValue, Text},
        header::LayerAttributes,
    },
    prelude::{ReadChannels, ReadLayers},
};

use super::{Image, ImageProblem, Texels, limits::check_size};

/// What the format is called in messages.
pub(super) const NAME: &str = "EXR";
/// The first bytes of every EXR file.
pub(super) const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
/// Bytes before the first attribute: magic and version.
const PREAMBLE: usize = 8;
/// Longest name that the format admits.
const MAX_NAME: usize = 255;
/// Text attributes that say how the file is built, not how the image was made.
const STRUCTURAL: [&str; 2] = ["type", "name"];

/// The rule that a metadata key breaks, if any. A dot is required because no standard attribute has
/// one, so a key can never change what the file means.
pub fn key_fault(key: &str) -> Option<&'static str> {
    if key.len() > MAX_NAME || key.contains('\0') {
        Some("use at most 255 bytes and no NUL")
    } else if !key.contains('.') {
        Some("a key must contain a dot, as in raywave.samples")
    } else {
        None
    }
}

/// Writes the image as an EXR file, a few lines at a time. The keys of `metadata` have passed
/// [`key_fault`] and differ.
pub fn encode(file: &mut (impl Read + Write + Seek), image: &Image, metadata: &[(String, String)]) -> io::Result<()> {
    let (width, height) = (image.width as usize, image.height as usize);
    let channels = SpecificChannels::rgb(|Vec2(x, y): Vec2<usize>| {
        let pixel = image.pixels[y * width + x];
        (pixel.x, pixel.y, pixel.z)
    });
    let records = records_of(metadata)?;
    let mut attributes = LayerAttributes::default();
    // The placeholder has the longest key as its name: by it the crate flags a file with long names.
    let longest = metadata.iter().map(|(key, _)| key).max_by_key(|key| key.len());
    if let Some(name) = longest {
        let bytes = vec![0; records.len() - record(name, 0).len()].into();
        let stand_in = AttributeValue::Custom { kind: Text::from(STRING), bytes };
        attributes.other.insert(Text::new_or_panic(name), stand_in);
    }
    // ZIP in increasing order of lines: the bytes do not depend on which thread was faster.
    let layer = Layer::new((width, height), attributes, Encoding::SMALL_LOSSLESS, channels);
    let mut buffered = BufWriter::new(&mut *file);
    ExrImage::from_layer(layer).write().to_buffered(&mut buffered).map_err(io::Error::other)?;
    buffered.flush()?;
    drop(buffered);
    if let Some(name) = longest {
        let place = place_of(file, name)?;
        file.seek(SeekFrom::Start(place))?;
        file.write_all(&records)?;
    }
    Ok(())
}

/// Type of a text attribute.
const STRING: &str = "string";

/// Name, type and size of a text attribute whose text has `size` bytes.
fn record(key: &str, size: i32) -> Vec<u8> {
    [key.as_bytes(), b"\0", STRING.as_bytes(), b"\0", &size.to_le_bytes()].concat()
}

/// The metadata as text attributes.
fn records_of(metadata: &[(String, String)]) -> io::Result<Vec<u8>> {
    let mut records = Vec::new();
    for (key, text) in metadata {
        let size =
            i32::try_from(text.len()).map_err(|_| io::Error::other(format!("the metadata {key} exceeds 2 GiB")))?;
        records.extend(record(key, size));
        records.extend(text.as_bytes());
    }
    Ok(records)
}

/// Where an attribute begins in the file.
fn place_of(file: &mut (impl Read + Seek), name: &str) -> io::Result<u64> {
    file.seek(SeekFrom::Start(PREAMBLE as u64))?;
    let mut reader = BufReader::new(file);
    loop {
        let place = reader.stream_position()?;
        match Attribute::read(&mut reader)? {
            Some(attribute) if attribute.name == name => return Ok(place),
            Some(_) => {}
            None => return Err(io::Error::other("the header lacks an attribute that was written")),
        }
    }
}

/// The text attributes of the first part, in the order of the file.
pub fn text_attributes(mut reader: impl BufRead) -> io::Result<Vec<(String, String)>> {
    let mut preamble = [0; PREAMBLE];
    reader.read_exact(&mut preamble)?;
    if preamble[..4] != MAGIC {
        return Err(io::Error::other("it does not begin with the EXR magic number"));
    }
    let mut texts = Vec::new();
    while let Some(attribute) = Attribute::read(&mut reader)? {
        if attribute.kind == STRING && !STRUCTURAL.contains(&attribute.name.as_str()) {
            let text = String::from_utf8_lossy(&attribute.value).into_owned();
            texts.push((attribute.name, text));
        }
    }
    Ok(texts)
}

/// One header entry.
struct Attribute {
    name: String,
    kind: String,
    value: Vec<u8>,
}

impl Attribute {
    /// The next attribute, or `None` behind the NUL that ends the header.
    fn read(reader: &mut impl BufRead) -> io::Result<Option<Self>> {
        let name = read_name(reader)?;
        if name.is_empty() {
            return Ok(None);
        }
        let kind = read_name(reader)?;
        let mut size = [0; 4];
        reader.read_exact(&mut size)?;
        let size = u64::try_from(i32::from_le_bytes(size))
            .map_err(|_| io::Error::other(format!("the attribute {name} has a negative size")))?;
        let mut value = Vec::new();
        reader.take(size).read_to_end(&mut value)?;
        if value.len() as u64 != size {
            return Err(io::Error::other(format!("it ends within the attribute {name}")));
        }
        Ok(Some(Self { name, kind, value }))
    }
}

fn read_name(reader: &mut impl BufRead) -> io::Result<String> {
    let mut name = Vec::new();
    reader.take(MAX_NAME as u64 + 1).read_until(0, &mut name)?;
    if name.pop() != Some(0) {
        return Err(io::Error::other("its header is damaged"));
    }
    Ok(String::from_utf8_lossy(&name).into_owned())
}

/// Reads the colour of a file; `f16`, `f32` and `u32` channels, any lossless or lossy compression, scanlines or tiles. The
/// data window becomes the image. Channels other than colour and alpha are ignored.
pub fn decode(bytes: &[u8]) -> Result<Texels, ImageProblem> {
    let damaged = |error: exr::error::Error| ImageProblem::decode(NAME, error);
    // The header first: it is small, and says whether the rest fits into memory.
    let meta = MetaData::read_from_buffered(bytes, false).map_err(damaged)?;
    for header in &meta.headers {
        check_size(header.layer_size.width() as u64, header.layer_size.height() as u64, bytes.len())?;
    }
    let channels = meta.headers.iter().flat_map(|header| &header.channels.list);
    let subsampled = channels.filter(|channel| channel.sampling != Vec2(1, 1));
    let subsampled: Vec<_> = subsampled.map(|channel| channel.name.to_string()).collect();
    if !subsampled.is_empty() {
        return Err(ImageProblem::Subsampled { channels: subsampled.join(", ") });
    }
    let file = read::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(damaged)?;

    let Colour { size: Vec2(width, height), rgb, alpha, .. } = Colour::of(&file.layer_data)?;
    let [mut r, mut g, mut b] = rgb.map(|channel| channel.sample_data.values_as_f32());
    let mut a = alpha.map(|channel| channel.sample_data.values_as_f32());
    let texel = || {
        let alpha = a.as_mut().map_or(Some(1.0), Iterator::next);
        Some([r.next()?, g.next()?, b.next()?, alpha?])
    };
    let rgba = std::iter::from_fn(texel).collect();
    Ok(Texels { width: width as u32, height: height as u32, rgba })
}

/// A part of a file, which the crate calls a layer.
type Part = Layer<AnyChannels<FlatSamples>>;

/// The channels that hold a colour and its alpha.
struct Colour<'a> {
    /// Of the group of channels or, of plain channels, of the part.
    name: String,
    size: Vec2<usize>,
    rgb: [&'a AnyChannel<FlatSamples>; 3],
    alpha: Option<&'a AnyChannel<FlatSamples>>,
}

impl<'a> Colour<'a> {
    /// What renderers call the image itself, behind the last dot: Blender, Arnold and V-Ray, Nuke and Houdini, others.
    const IMAGES: [&'static str; 4] = ["combined", "beauty", "rgba", "color"];

    /// The colour of the image itself: plain channels, and only where no part has any, a group of channels. Of several, the
    /// one whose name is that of an image counts, else of parts the first. Among groups of other names, the radiance and
    /// some albedo cannot be told apart.
    fn of(parts: &'a [Part]) -> Result<Self, ImageProblem> {
        let is_image = |colour: &Self, image: &str| {
            let last = colour.name.rsplit('.').next().unwrap_or_default();
            last.eq_ignore_ascii_case(image)
        };
        let plain = parts.iter().filter_map(Self::plain).collect::<Vec<_>>();
        let are_plain = !plain.is_empty();
        let mut colours = if are_plain { plain } else { parts.iter().flat_map(Self::groups).collect() };
        for image in Self::IMAGES {
            let mut places = (0..colours.len()).filter(|&place| is_image(&colours[place], image));
            match (places.next(), places.next()) {
                (None, _) => {}
                (Some(place), None) => return Ok(colours.swap_remove(place)),
                _ => break,
            }
        }
        if are_plain || colours.len() == 1 {
            return Ok(colours.swap_remove(0));
        }
        let channels = parts.iter().flat_map(|part| &part.channel_data.list);
        let list = |names: Vec<String>| names.join(", ");
        Err(match colours.is_empty() {
            true => {
                ImageProblem::NoColour { channels: list(channels.map(|channel| channel.name.to_string()).collect()) }
            }
            false => {
                ImageProblem::SeveralColours { groups: list(colours.into_iter().map(|colour| colour.name).collect()) }
            }
        })
    }

    /// `R`, `G`, `B`, else luminance `Y` for all three.
    fn plain(part: &'a Part) -> Option<Self> {
        let name = part.attributes.layer_name.as_ref().map_or_else(String::new, Text::to_string);
        let channel = |name: &str| channel_of(part, name);
        // With these, Y is one component of a colour: of CIE XYZ, or of luminance and chroma.
        let is_luminance = || ["X", "Z", "RY", "BY"].iter().all(|other| channel(other).is_none());
        Self::in_group(part, "", name.clone()).or_else(|| {
            let y = channel("Y").filter(|_| is_luminance())?;
            Some(Self { name, size: part.size, rgb: [y; 3], alpha: channel("A") })
        })
    }

    /// Every `name.R`, `name.G`, `name.B`.
    fn groups(part: &'a Part) -> impl Iterator<Item = Self> {
        part.channel_data.list.iter().filter_map(|channel| {
            let channel = channel.name.to_string();
            let name = channel.strip_suffix(".R")?;
            Self::in_group(part, &format!("{name}."), name.to_owned())
        })
    }

    fn in_group(part: &'a Part, prefix: &str, name: String) -> Option<Self> {
        let channel = |name: &str| channel_of(part, &format!("{prefix}{name}"));
        Some(Self { name, size: part.size, rgb: [channel("R")?, channel("G")?, channel("B")?], alpha: channel("A") })
    }
}

fn channel_of<'a>(part: &'a Part, name: &str) -> Option<&'a AnyChannel<FlatSamples>> {
    part.channel_data.list.iter().find(|channel| channel.name == *name)
}
