//! Loads damaged files until one of them does harm: a panic, 5 seconds, or a gigabyte.
//!
//!     cargo run --release --example fuzz_loaders -- [--for SECONDS] [--seed N] [--kind KIND]
//!
//! KIND is `all` or one of those that a wrong one is told. Small sound files of that kind are cut, spliced and given other
//! bytes and numbers, and loaded as a scene or as an image. A file that does harm is kept in the folder that the message
//! names, and the exit code is 1. The same seed gives the same files.

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::exit;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use std::{fs, thread};

use anyhow::{Context, bail};
use glam::Vec3;
use image::{DynamicImage, ImageFormat};
use raywave::image::{Encoding, Image, WriteOptions, decode_texels, image_bytes};
use raywave::scene::Scene;

/// Longest that a load may take.
const MOST_TIME: Duration = Duration::from_secs(5);
/// Most memory of the process, in KiB.
const MOST_MEMORY: u64 = 1 << 20;

const SCENE: &str = "[camera]\neye = [0, 1.0, 3.0]\ntarget = [0, 0, 0]\nup = [0, 1, 0]\nvfov = 60.0\naperture = 0.1\n\
    focus = 3.0\n[film]\nwidth = 64\nheight = 48\n[render]\nintegrator = \"mis\"\nsamples = 4\nmax_bounces = -1\n\
    roulette = 0.5\n[[mesh]]\nfile = \"m.obj\"\nscale = [1, 2, 3]\nrotate = [0, 90, 1e3]\ntranslate = [0, 1e-3, 0]\n\
    [[mesh]]\nfile = \"m.obj\"\n[material.a]\nillum = 6\nNi = 1.4\n[environment]\nfile = \"t.png\"\nscale = 2.0\n";
const MESH: &str = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0\nv 0.5 0.25 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n\
    usemtl a\nf 1/1/1 2/2/1 3/3/1\nusemtl b\nf -5 -4 -3 -2 # a comment\nf 1 2 5 3 \\\n 4\ns off\ng group\nf 1//1 2//1 4//1\n";
const MATERIALS: &str = "newmtl a\nKd 0.5 0.5 0.5\nKs 0.25\nNs 32\nillum 2\nmap_Kd -s 2 2 -o 0.5 0 t.png\nnewmtl b\n\
    Ke 1 1 1\nTf xyz 0.5 0.5\nNi 1.5\nd 0.5\nillum 7\nmap_Bump -bm 0.5 b.png\n";

/// Elements of a PLY file: a quadrilateral with all that a vertex may have, properties of no meaning here, and a strip.
const PLY: &str = "comment TextureFile t.png\nelement vertex 4\nproperty float x\nproperty double y\nproperty short z\n\
    property float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\nproperty uchar red\n\
    property uchar green\nproperty uchar blue\nelement camera 1\nproperty list uchar float view\nelement face 2\n\
    property uchar flags\nproperty list ushort int vertex_indices\nelement tristrips 1\n\
    property list int int vertex_indices\nend_header\n";
/// Triangles and no more, as most PLY files are.
const PLAIN_PLY: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n\
    property list uchar int vertex_indices\nend_header\n";
const MITSUBA: &str = "<scene version='3.0.0'><default name='r' value='0.25'/><integrator type='path'>\
    <integer name='max_depth' value='5'/></integrator><sensor type='thinlens'><float name='fov' value='40'/>\
    <float name='aperture_radius' value='0.1'/><transform name='to_world'><lookat origin='0,0,5' target='0,0,0' up='0,1,0'/>\
    </transform><film type='hdrfilm'><integer name='width' value='64'/></film><sampler type='independent'/></sensor>\n\
    <bsdf type='twosided' id='a'><bsdf type='roughconductor'><string name='material' value='Au'/>\
    <float name='alpha' value='$r'/></bsdf></bsdf>\n<bsdf type='blendbsdf' id='b'><float name='weight' value='0.5'/>\
    <bsdf type='plastic'><texture name='diffuse_reflectance' type='bitmap'><string name='filename' value='t.png'/>\
    <transform name='to_uv'><scale x='2'/></transform></texture></bsdf><bsdf type='mask'><float name='opacity' value='0.5'/>\
    <bsdf type='principled'><float name='metallic' value='0.5'/></bsdf></bsdf></bsdf>\n\
    <shape type='obj'><string name='filename' value='m.obj'/><ref id='a'/></shape>\
    <shape type='ply'><string name='filename' value='m.ply'/><boolean name='face_normals' value='true'/><ref id='b'/>\
    <transform name='to_world'><rotate x='1' angle='30'/><matrix value='1 0 0 0 0 -1 0 0 0 0 1 0 0 0 0 1'/></transform></shape>\n\
    <shape type='shapegroup' id='g'><shape type='cube'/><shape type='disk'/></shape><shape type='instance'><ref id='g'/>\
    </shape><shape type='cylinder'><bsdf type='bumpmap'><texture type='checkerboard'/><bsdf type='dielectric'>\
    <string name='int_ior' value='bk7'/></bsdf></bsdf></shape><shape type='rectangle'><emitter type='area'>\
    <spectrum name='radiance' value='400:1, 500:2, 700:3'/></emitter></shape>\n<emitter type='envmap'>\
    <string name='filename' value='t.png'/></emitter><emitter type='point'><rgb name='intensity' value='1 0.5 0'/></emitter>\
    <emitter type='spot'/><emitter type='directional'><vector name='direction' value='0 0 1'/></emitter></scene>";

/// A kind of file, and how it is loaded.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// A file of a scene, which has that name.
    Scene(&'static str),
    /// An image, whose name ends so.
    Image(&'static str),
}

const KINDS: [(&str, Kind); 16] = [
    ("toml", Kind::Scene("s.toml")),
    ("obj", Kind::Scene("m.obj")),
    ("mtl", Kind::Scene("m.mtl")),
    ("ply", Kind::Scene("m.ply")),
    ("gltf", Kind::Scene("m.gltf")),
    ("glb", Kind::Scene("m.glb")),
    ("xml", Kind::Scene("s.xml")),
    ("exr", Kind::Image("exr")),
    ("hdr", Kind::Image("hdr")),
    ("pfm", Kind::Image("pfm")),
    ("png", Kind::Image("png")),
    ("jpg", Kind::Image("jpg")),
    ("webp", Kind::Image("webp")),
    ("tif", Kind::Image("tif")),
    ("tga", Kind::Image("tga")),
    ("bmp", Kind::Image("bmp")),
];

struct Arguments {
    time: Duration,
    seed: u64,
    kinds: Vec<Kind>,
}

impl Arguments {
    fn parse() -> anyhow::Result<Self> {
        let mut parsed = Self { time: Duration::from_secs(60), seed: 1, kinds: KINDS.map(|(_, kind)| kind).to_vec() };
        let mut words = std::env::args().skip(1);
        while let Some(flag) = words.next() {
            let value = words.next().with_context(|| format!("{flag} needs a value"))?;
            match flag.as_str() {
                "--for" => parsed.time = Duration::from_secs_f64(value.parse().context("--for takes seconds")?),
                "--seed" => parsed.seed = value.parse().context("--seed takes a whole number")?,
                "--kind" if value == "all" => {}
                "--kind" => match KINDS.iter().find(|(name, _)| *name == value) {
                    Some((_, kind)) => parsed.kinds = vec![*kind],
                    None => bail!("--kind is all or one of {}", KINDS.map(|(name, _)| name).join(", ")),
                },
                _ => bail!("unknown flag {flag}; there are --for, --seed and --kind"),
            }
        }
        Ok(parsed)
    }
}

/// Sound files of a kind.
fn sound(kind: Kind) -> anyhow::Result<Vec<Vec<u8>>> {
    let extension = match kind {
        Kind::Scene("s.toml") => return Ok(vec![SCENE.into()]),
        Kind::Scene("m.obj") => return Ok(vec![MESH.into()]),
        Kind::Scene("m.ply") => return Ok(plys()),
        Kind::Scene("m.gltf") => return Ok(vec![gltf(None).0.into()]),
        Kind::Scene("m.glb") => return Ok(vec![glb()]),
        Kind::Scene("s.xml") => return Ok(vec![MITSUBA.into()]),
        Kind::Scene(_) => return Ok(vec![MATERIALS.into()]),
        Kind::Image(extension) => extension,
    };
    let colour = |x: u32, y: u32| Vec3::new(x as f32 / 7.0, y as f32, ((x * y) % 3) as f32);
    let pixels = (0..9 * 5).map(|place| colour(place % 9, place / 9)).collect();
    let image = Image::new(9, 5, pixels);
    let codes = |x, y| image::Rgba((255.0 * colour(x, y)).extend(200.0).to_array().map(|code| code as u8));
    let rgba = DynamicImage::from(image::RgbaImage::from_fn(9, 5, codes));
    let encoded = |image: &DynamicImage, format| -> anyhow::Result<Vec<u8>> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format)?;
        Ok(bytes.into_inner())
    };
    let own = || image_bytes(Path::new("a").with_extension(extension).as_ref(), &image, &WriteOptions::default());
    Ok(match extension {
        "pfm" => {
            let floats = image.pixels.iter().flat_map(|pixel| pixel.to_array().map(f32::to_le_bytes)).flatten();
            vec![b"PF\n9 5\n-1.0\n".iter().copied().chain(floats).collect(), b"Pf\n1 1\n1\n\0\0\0\0".to_vec()]
        }
        "exr" => vec![own()?, groups(9, 5)?],
        "hdr" => {
            let pixels: Vec<_> = image.pixels.iter().map(|pixel| image::Rgb(pixel.to_array())).collect();
            let mut runs = Vec::new();
            image::codecs::hdr::HdrEncoder::new(&mut runs).encode(&pixels, 9, 5)?;
            vec![own()?, runs]
        }
        "png" => vec![
            encoded(&rgba, ImageFormat::Png)?,
            encoded(&rgba.to_luma16().into(), ImageFormat::Png)?,
            encoded(&rgba.to_rgb8().into(), ImageFormat::Png)?,
        ],
        "jpg" => {
            vec![
                encoded(&rgba.to_rgb8().into(), ImageFormat::Jpeg)?,
                encoded(&rgba.to_luma8().into(), ImageFormat::Jpeg)?,
            ]
        }
        "webp" => vec![encoded(&rgba, ImageFormat::WebP)?],
        "tif" => vec![
            encoded(&rgba, ImageFormat::Tiff)?,
            encoded(&rgba.to_rgb32f().into(), ImageFormat::Tiff)?,
            encoded(&rgba.to_luma16().into(), ImageFormat::Tiff)?,
        ],
        "tga" => vec![encoded(&rgba, ImageFormat::Tga)?, encoded(&rgba.to_luma8().into(), ImageFormat::Tga)?],
        _ => vec![encoded(&rgba, ImageFormat::Bmp)?, encoded(&rgba.to_rgb8().into(), ImageFormat::Bmp)?],
    })
}

/// PLY files in all encodings.
fn plys() -> Vec<Vec<u8>> {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let mut text = format!("ply\nformat ascii 1.0\n{PLY}");
    for [x, y] in corners {
        text += &format!("{x} {y} 1 0 0 1 {x} {y} 255 128 0\n");
    }
    text += "2 1 2\n0 4 0 1 2 3\n1 3 0 1 2\n6 0 1 2 -1 3 2\n";
    let mut files = vec![text.into_bytes()];
    for is_big in [false, true] {
        let start = |elements| {
            let order = if is_big { "big" } else { "little" };
            format!("ply\nformat binary_{order}_endian 1.0\n{elements}").into_bytes()
        };
        let put = |bytes: &mut Vec<u8>, number: &[u8]| match is_big {
            true => bytes.extend(number.iter().rev()),
            false => bytes.extend(number),
        };
        let (mut whole, mut plain) = (start(PLY), start(PLAIN_PLY));
        for [x, y] in corners {
            put(&mut whole, &f32::to_le_bytes(x));
            put(&mut whole, &f64::from(y).to_le_bytes());
            put(&mut whole, &1_i16.to_le_bytes());
            [0.0, 0.0, 1.0, x, y].iter().for_each(|value| put(&mut whole, &f32::to_le_bytes(*value)));
            whole.extend([255, 128, 0]);
            [x, y, 0.0].iter().for_each(|value| put(&mut plain, &f32::to_le_bytes(*value)));
        }
        whole.push(1);
        put(&mut whole, &2_f32.to_le_bytes());
        for face in [&[0, 1, 2, 3][..], &[0, 1, 2]] {
            whole.push(0);
            put(&mut whole, &(face.len() as u16).to_le_bytes());
            face.iter().for_each(|corner| put(&mut whole, &i32::to_le_bytes(*corner)));
        }
        [6, 0, 1, 2, -1, 3, 2].iter().for_each(|number| put(&mut whole, &i32::to_le_bytes(*number)));
        for face in [[0, 1, 2], [0, 2, 3]] {
            plain.push(3);
            face.iter().for_each(|corner| put(&mut plain, &i32::to_le_bytes(*corner)));
        }
        files.extend([whole, plain]);
    }
    files
}

/// A glTF document and its buffer, whose URI is that.
fn gltf(uri: Option<&str>) -> (String, Vec<u8>) {
    let floats = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let square = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    let shorts = |values: &[u16]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let parts = [
        floats(&square),
        floats(&[0.0, 0.0, 1.0].repeat(4)),
        floats(&[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]),
        vec![255; 16],
        shorts(&[0, 1, 2, 0, 2, 3]),
        shorts(&[3, 0]),
        floats(&[0.0, 2.0, 0.0]),
        floats(&[0.0, 0.0, 0.0, 3.0, 0.0, 0.0]),
    ];
    let mut buffer = Vec::new();
    let mut views = Vec::new();
    for part in &parts {
        views.push(serde_json::json!({ "buffer": 0, "byteOffset": buffer.len(), "byteLength": part.len() }));
        buffer.extend(part);
    }
    let accessor = |view: usize, component: u32, kind: &str, count: usize| serde_json::json!({ "bufferView": view, "componentType": component, "type": kind, "count": count });
    let mut accessors = vec![
        accessor(0, 5126, "VEC3", 4),
        accessor(1, 5126, "VEC3", 4),
        accessor(2, 5126, "VEC2", 4),
        accessor(3, 5121, "VEC4", 4),
        accessor(4, 5123, "SCALAR", 6),
        accessor(7, 5126, "VEC3", 2),
    ];
    accessors[0]["sparse"] = serde_json::json!({
        "count": 1, "indices": { "bufferView": 5, "componentType": 5123 }, "values": { "bufferView": 6 }
    });
    accessors[3]["normalized"] = true.into();
    let encoded = base64::Engine::encode(&base64::prelude::BASE64_STANDARD, &buffer);
    let data = format!("data:application/octet-stream;base64,{encoded}");
    let mut document = serde_json::json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual", "KHR_texture_transform", "EXT_mesh_gpu_instancing"],
        "scene": 0,
        "scenes": [{ "nodes": [0, 2] }],
        "nodes": [
            { "children": [1], "rotation": [0, 0, 0, 1], "scale": [1, 2, -1], "translation": [0, 0, 1] },
            {
                "mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
                "extensions": { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 5 } } }
            },
            { "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } } }
        ],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1 } }],
        "meshes": [{ "primitives": [
            { "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "COLOR_0": 3 }, "indices": 4, "material": 0 },
            { "attributes": { "POSITION": 0 }, "mode": 5, "material": 1 }
        ] }],
        "materials": [
            {
                "pbrMetallicRoughness": {
                    "baseColorFactor": [1, 0.5, 0.5, 0.5], "metallicFactor": 0.5, "roughnessFactor": 0.4,
                    "baseColorTexture": {
                        "index": 0, "extensions": { "KHR_texture_transform": { "offset": [0.5, 0], "rotation": 0.3 } }
                    }
                },
                "normalTexture": { "index": 0, "scale": 0.5 }, "alphaMode": "MASK", "alphaCutoff": 0.4,
                "emissiveFactor": [1, 1, 0], "emissiveTexture": { "index": 0 }
            },
            { "extensions": {
                "KHR_materials_transmission": { "transmissionFactor": 0.5 }, "KHR_materials_ior": { "ior": 1.4 },
                "KHR_materials_clearcoat": { "clearcoatFactor": 1 }, "KHR_materials_volume": { "thicknessFactor": 1 },
                "KHR_materials_anisotropy": { "anisotropyStrength": 0.5 }
            } }
        ],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "magFilter": 9728, "wrapS": 33071 }],
        "images": [{ "uri": "t.png" }],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "spot", "intensity": 3, "spot": {} }] } }
    });
    document["accessors"] = accessors.into();
    document["bufferViews"] = views.into();
    document["buffers"] = serde_json::json!([{ "byteLength": buffer.len(), "uri": uri.unwrap_or(&data) }]);
    (document.to_string(), buffer)
}

/// A glTF document and its buffer in one file.
fn glb() -> Vec<u8> {
    let (json, binary) = gltf(Some(""));
    let mut json = json.replace(",\"uri\":\"\"", "").into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let word = |value: usize| (value as u32).to_le_bytes();
    let length = 28 + json.len() + binary.len();
    [b"glTF", &word(2)[..], &word(length), &word(json.len()), b"JSON", &json, &word(binary.len()), b"BIN\0", &binary]
        .concat()
}

/// An EXR of two groups of channels in tiles.
fn groups(width: usize, height: usize) -> anyhow::Result<Vec<u8>> {
    use exr::prelude::*;
    let channel = |name: &str| AnyChannel::new(name, FlatSamples::F16(vec![f16::from_f32(0.5); width * height]));
    let names = ["a.B", "a.G", "a.R", "beauty.A", "beauty.B", "beauty.G", "beauty.R"];
    let channels = AnyChannels::sort(names.map(channel).into_iter().collect());
    let encoding = exr::image::Encoding {
        compression: Compression::PIZ,
        blocks: Blocks::Tiles(Vec2(4, 4)),
        ..Encoding::FAST_LOSSLESS
    };
    let mut bytes = Cursor::new(Vec::new());
    let layer = Layer::new((width, height), LayerAttributes::named("part"), encoding, channels);
    exr::image::Image::from_layer(layer).write().to_buffered(&mut bytes)?;
    Ok(bytes.into_inner())
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// Below `end`, which may be 0.
    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }
}

/// Damages a file in one place.
fn damage(bytes: &mut Vec<u8>, other: &[u8], is_text: bool, random: &mut Random) {
    const NUMBERS: [u32; 12] =
        [0, 1, 2, 0x7f, 0xff, 0x7fff, 0xffff, 0x10000, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x0100_0000];
    const WORDS: [&str; 16] = [
        "0",
        "-1",
        "1e39",
        "-1e308",
        "nan",
        "inf",
        "4294967295",
        "99999999999999999999",
        "1e-320",
        "1/",
        "//",
        "\"\"",
        "[]",
        "\\",
        "#",
        "\u{feff}",
    ];
    let at = random.below(bytes.len());
    let end = (at + random.below(16)).min(bytes.len());
    let part = |random: &mut Random, whole: &[u8]| {
        let start = random.below(whole.len());
        whole[start..(start + random.below(64)).min(whole.len())].to_vec()
    };
    match random.below(if is_text { 9 } else { 7 }) {
        _ if bytes.is_empty() => bytes.extend(other),
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = random.next() as u8,
        2 | 3 => {
            let number = random.one_of(&NUMBERS);
            let number = if random.below(2) == 0 { number.to_le_bytes() } else { number.to_be_bytes() };
            let size = random.one_of(&[2, 4]);
            bytes.iter_mut().skip(at).zip(&number[..size]).for_each(|(byte, new)| *byte = *new);
        }
        4 => drop(bytes.drain(at..end)),
        5 => drop(bytes.splice(at..at, part(random, other))),
        6 if random.below(4) == 0 => bytes.truncate(at),
        6 => drop(bytes.splice(at..end, part(random, &bytes.clone()))),
        // The word here becomes another.
        _ => {
            let is_space = |byte: &u8| byte.is_ascii_whitespace();
            let start = bytes[..at].iter().rposition(is_space).map_or(0, |space| space + 1);
            let end = bytes[at..].iter().position(is_space).map_or(bytes.len(), |space| at + space);
            bytes.splice(start..end.max(start), random.one_of(&WORDS).bytes());
        }
    }
}

/// The largest memory that the process had, in KiB; 0 where the system does not tell.
fn peak_memory() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

/// A load that has begun.
struct Loading {
    start: Instant,
    file: PathBuf,
    bytes: Vec<u8>,
}

fn load(kind: Kind, file: &Path, folder: &Path, bytes: &[u8]) {
    match kind {
        Kind::Scene("m.obj" | "m.mtl") => drop(Scene::load(&folder.join("s.toml"))),
        Kind::Scene(name) => drop(Scene::load(&folder.join(name))),
        Kind::Image(_) => {
            if let Ok(texels) = decode_texels(file, bytes, Encoding::Srgb) {
                assert_eq!(texels.rgba.len() as u64, u64::from(texels.width) * u64::from(texels.height));
            }
        }
    }
}

fn main() -> anyhow::Result<()> {
    let Arguments { time, seed, kinds } = Arguments::parse()?;
    let folder = std::env::temp_dir().join(format!("raywave-fuzz-{seed}-{}", std::process::id()));
    fs::create_dir_all(&folder)?;
    let corpus: Vec<(Kind, Vec<Vec<u8>>)> =
        kinds.iter().map(|kind| Ok((*kind, sound(*kind)?))).collect::<anyhow::Result<_>>()?;
    let scene = [("s.toml", SCENE.as_bytes()), ("m.obj", MESH.as_bytes()), ("m.mtl", MATERIALS.as_bytes())];
    let (pixel, ply) = (sound(Kind::Image("png"))?, plys());
    let scene: Vec<_> = scene.into_iter().chain([("t.png", &pixel[0][..]), ("m.ply", &ply[0])]).collect();
    for (name, contents) in &scene {
        fs::write(folder.join(name), contents)?;
    }

    // What a load does not come back from is told by another thread.
    let loading: Arc<Mutex<Option<Loading>>> = Arc::default();
    let watched = Arc::clone(&loading);
    thread::spawn(move || {
        loop {
            thread::sleep(Duration::from_millis(100));
            if let Some(Loading { start, file, bytes }) = &*watched.lock().expect("nothing panics while it holds this")
                && start.elapsed() > MOST_TIME
            {
                drop(fs::write(file, bytes));
                println!("takes more than {} s: {}", MOST_TIME.as_secs(), file.display());
                exit(1);
            }
        }
    });
    // What is sound loads, so that damage reaches all of a loader.
    for (kind, files) in &corpus {
        if let Kind::Scene(name @ ("m.ply" | "m.gltf" | "m.glb" | "s.xml")) = kind {
            for bytes in files {
                fs::write(folder.join(name), bytes)?;
                Scene::load(&folder.join(name))?;
            }
        }
    }
    std::panic::set_hook(Box::new(|panic| eprintln!("{panic}")));

    let mut random = Random(seed);
    let start = Instant::now();
    let (mut loads, mut slowest) = (0u64, Duration::ZERO);
    while start.elapsed() < time {
        let (kind, files) = &corpus[random.below(corpus.len())];
        let mut bytes = files[random.below(files.len())].clone();
        let other = &files[random.below(files.len())];
        for _ in 0..1 + random.below(6) {
            damage(&mut bytes, other, matches!(kind, Kind::Scene(_)), &mut random);
        }
        let file = match kind {
            Kind::Scene(name) => folder.join(name),
            Kind::Image(extension) => folder.join("image").with_extension(extension),
        };
        if let Kind::Scene(_) = kind {
            fs::write(&file, &bytes)?;
        }
        let begun = Instant::now();
        *loading.lock().expect("nothing panics while it holds this") =
            Some(Loading { start: begun, file: file.clone(), bytes: bytes.clone() });
        let outcome = catch_unwind(AssertUnwindSafe(|| load(*kind, &file, &folder, &bytes)));
        *loading.lock().expect("nothing panics while it holds this") = None;
        slowest = slowest.max(begun.elapsed());
        loads += 1;
        let harm = match outcome {
            Err(_) => "panics",
            Ok(()) if peak_memory() > MOST_MEMORY => "takes more than a gigabyte",
            Ok(()) => {
                if let Some((name, contents)) = scene.iter().find(|(name, _)| *kind == Kind::Scene(name)) {
                    fs::write(folder.join(name), contents)?;
                }
                continue;
            }
        };
        fs::write(&file, &bytes)?;
        println!("{harm}: {}", file.display());
        exit(1);
    }
    fs::remove_dir_all(&folder)?;
    println!(
        "{loads} files did no harm; the slowest took {slowest:.1?}, the peak of memory was {} MiB",
        peak_memory() >> 10
    );
    Ok(())
}
