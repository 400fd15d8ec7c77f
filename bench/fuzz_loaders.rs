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

/// A kind of file, and how it is loaded.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// A file of a scene, which has that name.
    Scene(&'static str),
    /// An image, whose name ends so.
    Image(&'static str),
}

const KINDS: [(&str, Kind); 12] = [
    ("toml", Kind::Scene("s.toml")),
    ("obj", Kind::Scene("m.obj")),
    ("mtl", Kind::Scene("m.mtl")),
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
        Kind::Scene(_) => drop(Scene::load(&folder.join("s.toml"))),
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
    let pixel = sound(Kind::Image("png"))?;
    let scene: Vec<_> = scene.into_iter().chain([("t.png", &pixel[0][..])]).collect();
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
