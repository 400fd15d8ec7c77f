//! Images through files: round trips, exact codes, equal bytes, layouts of other renderers, and
//! what stays behind when writing fails.

use std::fs::{self, File};
use std::path::Path;

use exr::meta::attribute::AttributeValue;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image as ExrImage, Layer, LayerAttributes,
    LineOrder, MetaData, Vec2, WritableImage,
};
use glam::{DVec3, Vec3, dvec3, vec3};
use half::f16;
use raywave::film::FilmMoments;
use raywave::image::{
    Image, ImageError, ImageProblem, WriteOptions, check_output, image_bytes, read_image, read_metadata, srgb,
    write_image,
};
use raywave_studies::stats::SplitMix64;
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// An image whose radiance spans twelve decades.
fn noise(width: u32, height: u32) -> Image {
    let mut random = SplitMix64::new(u64::from(width) << 32 | u64::from(height));
    let mut channel = || 10f64.powf(random.next_f64() * 12.0 - 6.0) as f32;
    let pixels = (0..width * height).map(|_| vec3(channel(), channel(), channel()));
    Image::new(width, height, pixels.collect())
}

/// A one-row image.
fn row(pixels: &[Vec3]) -> Image {
    Image::new(pixels.len() as u32, 1, pixels.to_vec())
}

fn bits(image: &Image) -> Vec<[u32; 3]> {
    let pixels = image.pixels.iter();
    pixels.map(|p| p.to_array().map(f32::to_bits)).collect()
}

fn pairs(list: &[(&str, &str)]) -> Vec<(String, String)> {
    list.iter().map(|&(k, v)| (k.into(), v.into())).collect()
}

fn write(path: &Path, image: &Image) {
    write_image(path, image, &WriteOptions::default()).unwrap();
}

fn files_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

// Round trips

#[test]
fn exr_keeps_every_bit_at_every_size() {
    let folder = folder();
    // ZIP packs 16 lines: below, at and above one chunk and several.
    for (width, height) in [(1, 1), (1, 40), (7, 15), (16, 16), (33, 17), (130, 97)] {
        let path = folder.path().join(format!("{width}x{height}.exr"));
        let image = noise(width, height);
        write(&path, &image);
        assert_eq!(read_image(&path).unwrap(), image);
    }
}

#[test]
fn exr_keeps_what_is_not_a_number() {
    let strange = [
        f32::NAN,
        f32::from_bits(0xffc0_1234),
        f32::INFINITY,
        f32::NEG_INFINITY,
        -0.0,
        f32::MIN_POSITIVE / 8.0,
        f32::MAX,
        -3.5,
        1.0,
    ];
    let image = row(&strange.map(|value| vec3(value, 1.0, -value)));
    let folder = folder();
    let path = folder.path().join("strange.exr");
    write(&path, &image);
    assert_eq!(bits(&read_image(&path).unwrap()), bits(&image));
}

#[test]
fn png_codes_survive_a_round_trip() {
    let folder = folder();
    let codes: Vec<Vec3> = (0..=255u8).map(|code| Vec3::splat(srgb::decode(f64::from(code) / 255.0) as f32)).collect();
    let (first, second) = (folder.path().join("1.png"), folder.path().join("2.png"));
    write(&first, &row(&codes));
    assert_eq!(read_image(&first).unwrap().pixels, codes);
    write(&second, &read_image(&first).unwrap());
    assert_eq!(fs::read(first).unwrap(), fs::read(second).unwrap());
}

#[test]
fn hdr_stays_within_half_a_step_and_does_not_darken() {
    let folder = folder();
    let path = folder.path().join("noise.hdr");
    let image = noise(200, 100);
    write(&path, &image);
    let back = read_image(&path).unwrap();
    let mut bias = 0.0;
    for (a, b) in image.pixels.iter().zip(&back.pixels) {
        // The largest mantissa is at least 128, so half a step is 1/256 of it.
        let step = f64::from(a.max_element()) / 128.0;
        for (a, b) in a.to_array().into_iter().zip(b.to_array()) {
            let error = f64::from(b) - f64::from(a);
            assert!(error.abs() <= step / 2.0, "{a} became {b}");
            bias += error / step / (3.0 * image.pixels.len() as f64);
        }
    }
    // Truncation would give -0.35 steps. Small channels all round to 0, a bias of their own.
    assert!(bias.abs() < 0.01, "bias {bias} steps");
}

#[test]
fn hdr_has_an_answer_for_every_float() {
    let folder = folder();
    let path = folder.path().join("extremes.hdr");
    let image = row(&[
        Vec3::ZERO,
        Vec3::splat(-1.0),
        Vec3::splat(f32::NAN),
        vec3(f32::INFINITY, 1.0, f32::NAN),
        Vec3::splat(f32::MAX),
        Vec3::splat(f32::MIN_POSITIVE / 4.0),
        // Rounds up into the next power of two.
        Vec3::splat(0.999_999),
        vec3(1.0, 0.5, 0.25),
        Vec3::splat(1e-30),
    ]);
    write(&path, &image);
    let back = read_image(&path).unwrap().pixels;
    let largest = 255.0 * 2f32.powi(119);
    assert_eq!(back[..3], [Vec3::ZERO; 3]);
    assert_eq!(back[3], vec3(largest, 0.0, 0.0));
    assert_eq!(back[4], Vec3::splat(largest));
    assert_eq!(back[5], Vec3::ZERO);
    assert_eq!(back[6], Vec3::ONE);
    assert_eq!(back[7], vec3(1.0, 0.5, 0.25));
    assert!((back[8].x / 1e-30 - 1.0).abs() < 1.0 / 256.0);
}

#[test]
fn hdr_of_other_programs_is_read() {
    let folder = folder();
    let path = folder.path().join("rle.hdr");
    // Runs, so that the file is run-length coded in earnest.
    let colours = [[1.0, 0.5, 0.25], [2.0, 2.0, 2.0]];
    let pixels: Vec<_> = (0..64 * 4).map(|i| image::Rgb(colours[i / 40 % 2])).collect();
    let mut bytes = Vec::new();
    image::codecs::hdr::HdrEncoder::new(&mut bytes).encode(&pixels, 64, 4).unwrap();
    fs::write(&path, bytes).unwrap();
    let expected: Vec<Vec3> = pixels.iter().map(|p| Vec3::from(p.0)).collect();
    assert_eq!(read_image(&path).unwrap().pixels, expected);

    let exposed = b"#?RGBE\nEXPOSURE=2.0\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n\x80\x40\x20\x81";
    fs::write(&path, exposed).unwrap();
    assert_eq!(read_image(&path).unwrap().pixels, [vec3(0.5, 0.25, 0.125)]);
}

// Exact codes

#[test]
fn srgb_has_its_known_values() {
    for (linear, code) in [
        (0.0, 0),
        (0.18, 118),
        (0.214_041, 127), // 127.5 / 255 is 0.214_041_14 in linear light
        (0.214_042, 128),
        (0.5, 188),
        (1.0, 255),
        (0.003_130_8, 10),
        (1.0 / 255.0 / 12.92, 1),
        (0.499 / 255.0 / 12.92, 0),
        (2.0, 255),
        (-1.0, 0),
        (f64::INFINITY, 255),
        (f64::NEG_INFINITY, 0),
        (f64::NAN, 0),
    ] {
        assert_eq!(srgb::encode_byte(linear), code, "linear {linear}");
    }
    assert!((srgb::encode(0.214_041_14) - 0.5).abs() < 1e-8);
    assert!((srgb::decode(0.5) - 0.214_041_14).abs() < 1e-8);
    // The standard's two pieces do not meet exactly; they come within 1e-7.
    let (below, above) = (srgb::encode(0.003_130_8), srgb::encode(0.003_130_800_1));
    assert!((above - below).abs() < 1e-7);
}

#[test]
fn exposure_counts_in_stops_and_light_clamps() {
    let folder = folder();
    let path = folder.path().join("exposed.png");
    for (exposure, radiance, code) in
        [(0.0, 0.5, 188), (1.0, 0.25, 188), (-2.0, 2.0, 188), (1.0, 0.5, 255), (0.0, 7.0, 255), (10.0, f32::NAN, 0)]
    {
        let options = WriteOptions { exposure, ..WriteOptions::default() };
        write_image(&path, &row(&[Vec3::splat(radiance)]), &options).unwrap();
        let code_in_file = image::open(&path).unwrap().to_rgb8().get_pixel(0, 0).0;
        assert_eq!(code_in_file, [code; 3], "{radiance} at {exposure} stops");
    }
}

#[test]
fn exposure_leaves_linear_formats_alone() {
    let image = noise(9, 9);
    let metadata = pairs(&[("raywave.samples", "4")]);
    for name in ["x.exr", "x.hdr"] {
        let bytes = |exposure| {
            let options = WriteOptions { exposure, metadata: &metadata, format: None };
            image_bytes(Path::new(name), &image, &options).unwrap()
        };
        assert_eq!(bytes(0.0), bytes(3.0));
    }
}

#[test]
fn rows_run_from_top_to_bottom_and_channels_are_rgb() {
    let folder = folder();
    let image = Image::new(
        2,
        2,
        vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE], // red, green / blue, white
    );
    for name in ["a.exr", "a.png", "a.hdr"] {
        let path = folder.path().join(name);
        write(&path, &image);
        assert_eq!(read_image(&path).unwrap(), image, "{name}");
    }
    let png = image::open(folder.path().join("a.png")).unwrap().to_rgb8();
    assert_eq!(png.get_pixel(0, 1).0, [0, 0, 255]);
}

// Metadata

#[test]
fn metadata_comes_back_in_order() {
    let folder = folder();
    let path = folder.path().join("meta.exr");
    let long_key = format!("raywave.{}", "k".repeat(100));
    let mut metadata = pairs(&[
        ("raywave.samples", "4096"),
        ("raywave.device", "Grün & Söhne — 設備"),
        ("raywave.empty", ""),
        ("a.key", "two\nlines\tand \"quotes\""),
        (&long_key, "long"),
    ]);
    metadata.push(("raywave.scene".into(), "x".repeat(100_000)));
    let image = noise(40, 50);
    let options = WriteOptions { metadata: &metadata, ..WriteOptions::default() };
    write_image(&path, &image, &options).unwrap();
    assert_eq!(read_metadata(&path).unwrap(), metadata);
    assert_eq!(read_image(&path).unwrap(), image);

    // The exr crate, which knows nothing of this, finds the same attributes and is strict here.
    let meta = MetaData::read_from_file(&path, true).unwrap();
    let attributes = &meta.headers[0].own_attributes.other;
    assert_eq!(attributes.len(), metadata.len());
    for (key, text) in &metadata {
        let value = &attributes[&exr::prelude::Text::new_or_panic(key)];
        let AttributeValue::Text(value) = value else {
            panic!("{key} is no text");
        };
        assert_eq!(value.bytes(), text.as_bytes());
    }
}

#[test]
fn metadata_that_would_change_the_file_is_refused() {
    let folder = folder();
    let path = folder.path().join("meta.exr");
    let long = format!("a.{}", "x".repeat(254));
    for bad in [
        pairs(&[("channels", "x")]),
        pairs(&[("", "x")]),
        pairs(&[("a.\0", "x")]),
        pairs(&[(&long, "x")]),
        pairs(&[("a.b", "x"), ("a.c", "x"), ("a.b", "x")]),
    ] {
        let options = WriteOptions { metadata: &bad, ..WriteOptions::default() };
        let error = write_image(&path, &noise(2, 2), &options).unwrap_err();
        assert!(matches!(error.problem, ImageProblem::MetadataKey { .. }), "{error}");
    }
    assert!(files_in(folder.path()).is_empty());
}

#[test]
fn only_exr_is_asked_for_metadata() {
    let folder = folder();
    let path = folder.path().join("a.png");
    write(&path, &noise(2, 2));
    let error = read_metadata(&path).unwrap_err();
    assert!(matches!(error.problem, ImageProblem::NoMetadata));
    let path = folder.path().join("plain.exr");
    write(&path, &noise(2, 2));
    assert!(read_metadata(&path).unwrap().is_empty());
}

// Equal bytes

#[test]
fn the_same_image_gives_the_same_bytes() {
    // Many keys, so that an order by chance would hardly repeat; many chunks for many threads.
    let metadata: Vec<_> = (0..20).map(|i| (format!("raywave.key{i}"), format!("{i}"))).collect();
    let options = WriteOptions { exposure: 0.5, metadata: &metadata, format: None };
    let image = noise(64, 400);
    for name in ["x.exr", "x.png", "x.hdr"] {
        let first = image_bytes(Path::new(name), &image, &options).unwrap();
        for _ in 0..5 {
            assert!(image_bytes(Path::new(name), &image, &options).unwrap() == first, "{name}");
        }
    }
}

// Layouts of other renderers

/// One EXR layer with channels as they come.
fn exr_layer(
    size: (usize, usize),
    encoding: Encoding,
    attributes: LayerAttributes,
    channels: &[(&str, FlatSamples)],
) -> Layer<AnyChannels<FlatSamples>> {
    let channels = channels.iter().map(|(name, samples)| AnyChannel::new(*name, samples.clone()));
    Layer::new(size, attributes, encoding, AnyChannels::sort(channels.collect()))
}

fn exr_file(path: &Path, layers: Vec<Layer<AnyChannels<FlatSamples>>>) {
    let size = layers[0].size;
    let image = ExrImage::from_layers(exr::prelude::ImageAttributes::with_size(size), layers);
    image.write().to_file(path).unwrap();
}

fn halves(values: &[f32]) -> FlatSamples {
    FlatSamples::F16(values.iter().map(|&v| f16::from_f32(v)).collect())
}

fn floats(values: &[f32]) -> FlatSamples {
    FlatSamples::F32(values.to_vec())
}

#[test]
fn colour_is_found_among_other_channels() {
    let folder = folder();
    let path = folder.path().join("render.exr");
    let (r, g, b, other) = ([0.5, 1.0], [0.25, 2.0], [0.125, 65504.0], [9.0, 9.0]);
    let expected = row(&[vec3(0.5, 0.25, 0.125), vec3(1.0, 2.0, 65504.0)]);
    let grey = row(&[Vec3::splat(0.5), Vec3::splat(1.0)]);
    type Channels<'a> = Vec<(&'a str, FlatSamples)>;
    let cases: Vec<(&str, Channels, &Image)> = vec![
        (
            "half RGBA, the default of Mitsuba's film",
            vec![("R", halves(&r)), ("G", halves(&g)), ("B", halves(&b)), ("A", halves(&other))],
            &expected,
        ),
        (
            "float RGB with auxiliary channels",
            vec![
                ("R", floats(&r)),
                ("G", floats(&g)),
                ("B", floats(&b)),
                ("albedo.R", halves(&other)),
                ("albedo.G", halves(&other)),
                ("albedo.B", halves(&other)),
                ("depth.T", floats(&other)),
            ],
            &expected,
        ),
        ("mixed precision", vec![("R", floats(&r)), ("G", halves(&g)), ("B", floats(&b))], &expected),
        (
            "one named group",
            vec![
                ("image.R", floats(&r)),
                ("image.G", floats(&g)),
                ("image.B", floats(&b)),
                ("image.A", floats(&other)),
                ("normal.X", floats(&other)),
            ],
            &expected,
        ),
        (
            "luminance with auxiliary channels",
            vec![("Y", halves(&r)), ("albedo.R", floats(&other)), ("depth.T", floats(&other))],
            &grey,
        ),
    ];
    for (name, channels, expected) in cases {
        let layer = exr_layer((2, 1), Encoding::SMALL_LOSSLESS, LayerAttributes::default(), &channels);
        exr_file(&path, vec![layer]);
        assert_eq!(&read_image(&path).unwrap(), expected, "{name}");
    }
}

#[test]
fn tiles_compressions_windows_and_parts_are_read() {
    let folder = folder();
    let path = folder.path().join("render.exr");
    let image = noise(70, 45);
    let channel = |i: usize| floats(&image.pixels.iter().map(|p| p[i]).collect::<Vec<_>>());
    let rgb = [("R", channel(0)), ("G", channel(1)), ("B", channel(2))];
    for compression in
        [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ]
    {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(32, 16))] {
            let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
            // A crop: the data window is not at the origin.
            let attributes = LayerAttributes::named("main").with_position(Vec2(-5, 12));
            exr_file(&path, vec![exr_layer((70, 45), encoding, attributes, &rgb)]);
            assert_eq!(read_image(&path).unwrap(), image, "{compression} {blocks:?}");
        }
    }
    let encoding = Encoding::FAST_LOSSLESS;
    let depth = exr_layer((70, 45), encoding, LayerAttributes::named("depth"), &[("Z", channel(0))]);
    let colour = exr_layer((70, 45), encoding, LayerAttributes::named("colour"), &rgb);
    exr_file(&path, vec![depth, colour]);
    assert_eq!(read_image(&path).unwrap(), image);
}

#[test]
fn exr_without_plain_colour_says_what_it_has() {
    let folder = folder();
    let path = folder.path().join("depth.exr");
    for names in [&["G", "Z"][..], &["BY", "RY", "Y"]] {
        let channels: Vec<_> = names.iter().map(|&name| (name, floats(&[1.0]))).collect();
        let attributes = LayerAttributes::default();
        exr_file(&path, vec![exr_layer((1, 1), Encoding::UNCOMPRESSED, attributes, &channels)]);
        let error = read_image(&path).unwrap_err();
        assert!(matches!(error.problem, ImageProblem::NoColour { .. }));
        assert!(error.to_string().contains(&names.join(", ")), "{error}");
        assert_well_spoken(&error, &path);
    }

    // Two values of RY for four pixels: name and NUL, type, whether it is linear, and the two sampling rates.
    let channels: Vec<_> = ["BY", "RY", "Y"].map(|name| (name, floats(&[1.0; 4]))).into();
    let layer = exr_layer((2, 2), Encoding::UNCOMPRESSED, LayerAttributes::default(), &channels);
    exr_file(&path, vec![layer]);
    let mut bytes = fs::read(&path).unwrap();
    let rates = bytes.windows(4).position(|word| word == b"\0RY\0").unwrap() + 4 + 8;
    bytes[rates] = 2;
    fs::write(&path, &bytes).unwrap();
    let error = read_image(&path).unwrap_err();
    assert!(error.to_string().contains("channels RY have fewer values than pixels"), "{error}");
    assert_well_spoken(&error, &path);
}

#[test]
fn the_image_is_found_among_groups_by_its_name() {
    let folder = folder();
    let path = folder.path().join("layers.exr");
    let channels_of = |groups: &[&str]| -> Vec<(String, FlatSamples)> {
        let values = |place: usize| floats(&[place as f32]);
        let group = |(place, name): (usize, &&str)| ["B", "G", "R"].map(|c| (format!("{name}{c}"), values(place)));
        groups.iter().enumerate().flat_map(group).collect()
    };
    let part = |name: Option<&str>, groups: &[&str]| {
        let channels = channels_of(groups);
        let channels: Vec<_> = channels.iter().map(|(name, values)| (name.as_str(), values.clone())).collect();
        let attributes = name.map_or_else(LayerAttributes::default, LayerAttributes::named);
        exr_layer((1, 1), Encoding::UNCOMPRESSED, attributes, &channels)
    };
    // The value of each group is its place in the list, so the pixel tells which was taken.
    for (groups, taken) in [
        (&["ViewLayer.Albedo.", "ViewLayer.Combined."][..], 1.0),
        (&["Beauty.", "albedo.", "color."], 0.0),
        (&["alb.", "img.", "RGBA."], 2.0),
        (&["", "beauty."], 0.0),
    ] {
        exr_file(&path, vec![part(None, groups)]);
        assert_eq!(read_image(&path).unwrap().pixels, [Vec3::splat(taken)], "{groups:?}");
    }
    for groups in [&["alb.", "img."][..], &["Back.Combined.", "Front.Combined."]] {
        exr_file(&path, vec![part(None, groups)]);
        let error = read_image(&path).unwrap_err();
        assert!(matches!(error.problem, ImageProblem::SeveralColours { .. }), "{error}");
        assert!(error.to_string().contains(&groups.join(", ").replace(".,", ",")[..7]), "{error}");
        assert_well_spoken(&error, &path);
    }
    // Parts, in place of groups.
    exr_file(&path, vec![part(Some("albedo"), &["a.", ""]), part(Some("beauty"), &[""])]);
    assert_eq!(read_image(&path).unwrap().pixels, [Vec3::ZERO]);
    exr_file(&path, vec![part(Some("albedo"), &["a.", ""]), part(Some("normal"), &[""])]);
    assert_eq!(read_image(&path).unwrap().pixels, [Vec3::ONE]);
}

#[test]
fn png_of_other_programs_is_read() {
    let folder = folder();
    let path = folder.path().join("other.png");
    let linear = |code: f64| srgb::decode(code) as f32;
    image::ImageBuffer::from_pixel(1, 1, image::Rgb([0u16, 257, 40_000])).save(&path).unwrap();
    let expected = vec3(0.0, linear(1.0 / 255.0), linear(40_000.0 / 65_535.0));
    assert_eq!(read_image(&path).unwrap().pixels, [expected]);

    image::ImageBuffer::from_pixel(1, 1, image::Rgba([10u8, 20, 30, 0])).save(&path).unwrap();
    let expected = Vec3::from([10.0, 20.0, 30.0].map(|code| linear(code / 255.0)));
    assert_eq!(read_image(&path).unwrap().pixels, [expected]);

    image::ImageBuffer::from_pixel(1, 1, image::Luma([77u8])).save(&path).unwrap();
    let expected = Vec3::splat(linear(77.0 / 255.0));
    assert_eq!(read_image(&path).unwrap().pixels, [expected]);
}

// Failures

/// Every message is one line and names the file.
fn assert_well_spoken(error: &ImageError, path: &Path) {
    let message = error.to_string();
    assert!(message.starts_with(&path.display().to_string()), "{message}");
    assert!(!message.contains('\n'), "{message}");
}

#[test]
fn outputs_are_checked_before_the_work() {
    let folder = folder();
    let inside = |name: &str| folder.path().join(name);
    fs::create_dir(inside("folder.exr")).unwrap();

    for name in ["a.exr", "a.png", "a.hdr", "A.EXR", "two.dots.png"] {
        check_output(&inside(name), None).unwrap();
    }
    for name in ["a", "a.jpg", "a.exr.", "exr", ".exr"] {
        let error = check_output(&inside(name), None).unwrap_err();
        assert!(matches!(error.problem, ImageProblem::UnknownFormat { .. }), "{error}");
        assert_well_spoken(&error, &inside(name));
    }
    let error = check_output(&inside("folder.exr"), None).unwrap_err();
    assert!(error.to_string().contains("it is a folder"), "{error}");
    assert_well_spoken(&error, &inside("folder.exr"));

    let error = check_output(&inside("no/such/a.exr"), None).unwrap_err();
    assert!(error.to_string().contains("create it"), "{error}");
    assert_well_spoken(&error, &inside("no/such/a.exr"));

    assert_eq!(files_in(folder.path()), ["folder.exr"]);
}

/// A folder of the kernel's own, which takes no files even from the superuser.
#[cfg(target_os = "linux")]
#[test]
fn unwritable_folders_are_noticed() {
    let path = Path::new("/proc/self/a.exr");
    for error in
        [check_output(path, None).unwrap_err(), write_image(path, &noise(2, 2), &WriteOptions::default()).unwrap_err()]
    {
        assert!(matches!(error.problem, ImageProblem::Write { .. }), "{error}");
        assert_well_spoken(&error, path);
    }
}

#[test]
fn a_failed_write_leaves_nothing_behind_and_the_old_file_alone() {
    let folder = folder();
    let inside = |name: &str| folder.path().join(name);
    fs::create_dir_all(inside("target.exr/full")).unwrap();
    write(&inside("old.exr"), &noise(3, 3));
    let old = fs::read(inside("old.exr")).unwrap();

    let empty = Image::new(0, 5, Vec::new());
    let lying = Image { width: 4, ..noise(3, 3) };
    let bad_key = pairs(&[("nodot", "x")]);
    for (path, image, metadata) in [
        (inside("target.exr"), &noise(3, 3), &[][..]),
        (inside("missing/a.png"), &noise(3, 3), &[]),
        (inside("old.exr"), &noise(3, 3), &bad_key),
        (inside("old.exr"), &empty, &[]),
        (inside("old.exr"), &lying, &[]),
        (inside("a.bmp"), &noise(3, 3), &[]),
    ] {
        let options = WriteOptions { metadata, ..WriteOptions::default() };
        let error = write_image(&path, image, &options).unwrap_err();
        assert_well_spoken(&error, &path);
    }
    assert_eq!(files_in(folder.path()), ["old.exr", "target.exr"]);
    assert_eq!(fs::read(inside("old.exr")).unwrap(), old);

    write(&inside("old.exr"), &noise(5, 5));
    assert_eq!(read_image(&inside("old.exr")).unwrap(), noise(5, 5));
    assert_eq!(files_in(folder.path()), ["old.exr", "target.exr"]);
}

#[cfg(unix)]
#[test]
fn images_have_the_permissions_of_any_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder();
    let mode = |name: &str| {
        let path = folder.path().join(name);
        fs::metadata(path).unwrap().permissions().mode()
    };
    File::create(folder.path().join("plain")).unwrap();
    write(&folder.path().join("image.exr"), &noise(2, 2));
    assert_eq!(mode("image.exr"), mode("plain"));
}

#[test]
fn a_bare_file_name_means_the_current_folder() {
    check_output(Path::new("bare.exr"), None).unwrap();
    assert!(!Path::new("bare.exr").exists());
}

#[test]
fn damaged_files_are_errors() {
    let folder = folder();
    let metadata = pairs(&[("raywave.samples", "16")]);
    let options = WriteOptions { metadata: &metadata, ..WriteOptions::default() };
    for name in ["a.exr", "a.png", "a.hdr"] {
        let path = folder.path().join(name);
        let bytes = image_bytes(&path, &noise(9, 20), &options).unwrap();
        for length in (0..bytes.len() - 20).step_by(7) {
            fs::write(&path, &bytes[..length]).unwrap();
            let error = read_image(&path).unwrap_err();
            assert!(matches!(error.problem, ImageProblem::Decode { .. }), "{error}");
            assert_well_spoken(&error, &path);
        }
        // Flipped bytes may go unnoticed, but they must not bring the program down.
        for index in (0..bytes.len().min(600)).step_by(3) {
            let mut bytes = bytes.clone();
            bytes[index] ^= 0xa5;
            fs::write(&path, bytes).unwrap();
            let _ = read_image(&path);
            if name.ends_with("exr") {
                let _ = read_metadata(&path);
            }
        }
    }
    for name in ["missing.exr", "missing.png", "missing.hdr"] {
        let path = folder.path().join(name);
        let error = read_image(&path).unwrap_err();
        assert!(matches!(error.problem, ImageProblem::Open { .. }), "{error}");
        assert_well_spoken(&error, &path);
    }
}

#[test]
fn a_wrong_extension_is_an_error() {
    let folder = folder();
    let names = ["a.exr", "a.png", "a.hdr"];
    for wrote in names {
        let bytes = image_bytes(Path::new(wrote), &noise(4, 4), &WriteOptions::default()).unwrap();
        for read in names.into_iter().filter(|&name| name != wrote) {
            let path = folder.path().join(read);
            fs::write(&path, &bytes).unwrap();
            assert!(read_image(&path).is_err(), "{wrote} read as {read}");
        }
    }
}

#[test]
fn a_header_cannot_ask_for_all_memory() {
    let folder = folder();
    let path = folder.path().join("huge.hdr");
    fs::write(&path, b"#?RADIANCE\n\n-Y 1000000 +X 1000000\n").unwrap();
    let error = read_image(&path).unwrap_err();
    assert!(matches!(error.problem, ImageProblem::TooLarge { .. }), "{error}");

    let path = folder.path().join("huge.exr");
    let mut bytes = image_bytes(&path, &noise(1, 1), &WriteOptions::default()).unwrap();
    let window = bytes.windows(16).position(|w| w == b"dataWindow\0box2i").unwrap();
    // Behind the name, the type and the size: x and y of the first corner, then of the last.
    let last_corner = window + 17 + 4 + 8;
    bytes[last_corner..last_corner + 8]
        .copy_from_slice(&[1_000_000i32.to_le_bytes(), 1_000_000i32.to_le_bytes()].concat());
    fs::write(&path, &bytes).unwrap();
    assert!(read_image(&path).is_err());
}

// Moments

#[test]
fn moments_give_mean_and_variance_of_the_mean() {
    // Samples 1, 2, 4 and 0, 0, 6; blue is constant.
    let moments = FilmMoments {
        width: 2,
        height: 1,
        samples: 3,
        sum: vec![dvec3(7.0, 6.0, 0.3), dvec3(6.0, 7.0, 0.3)],
        sum_of_squares: vec![dvec3(21.0, 36.0, 0.03), dvec3(36.0, 21.0, 0.03)],
    };
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} is not {b}");
    let mean = moments.mean();
    assert_eq!((mean.width, mean.height), (2, 1));
    close(mean.pixels[0].x.into(), 7.0 / 3.0);
    close(mean.pixels[0].y.into(), 2.0);
    // Sample variance 7/3 of 1, 2, 4 and 12 of 0, 0, 6; of the mean a third.
    let variance = moments.variance_of_mean();
    close(variance.pixels[0].x.into(), 7.0 / 9.0);
    close(variance.pixels[0].y.into(), 4.0);
    assert!(variance.pixels[0].z >= 0.0 && variance.pixels[0].z < 1e-9);

    let whole = moments.mean_and_standard_error();
    close(whole.mean.x, 13.0 / 6.0);
    close(whole.standard_error.x, (7.0f64 / 9.0 + 4.0).sqrt() / 2.0);
}

#[test]
fn few_samples_admit_that_nothing_is_known() {
    let with = |samples| FilmMoments {
        width: 1,
        height: 1,
        samples,
        sum: vec![DVec3::splat(samples as f64)],
        sum_of_squares: vec![DVec3::splat(samples as f64)],
    };
    assert!(with(0).mean().pixels[0].is_nan());
    assert_eq!(with(0).variance_of_mean().pixels[0], Vec3::INFINITY);
    assert_eq!(with(1).mean().pixels[0], Vec3::ONE);
    assert_eq!(with(1).variance_of_mean().pixels[0], Vec3::INFINITY);
    assert_eq!(with(1).mean_and_standard_error().standard_error, DVec3::INFINITY);
    assert_eq!(with(2).variance_of_mean().pixels[0], Vec3::ZERO);
}

#[test]
fn a_spoilt_pixel_stays_spoilt() {
    let moments = FilmMoments {
        width: 1,
        height: 1,
        samples: 8,
        sum: vec![dvec3(f64::NAN, f64::INFINITY, 1.0)],
        sum_of_squares: vec![dvec3(f64::NAN, f64::INFINITY, 1.0)],
    };
    let variance = moments.variance_of_mean().pixels[0];
    assert!(moments.mean().pixels[0].x.is_nan() && variance.x.is_nan());
    assert!(moments.mean().pixels[0].y == f32::INFINITY && variance.y.is_nan());
    assert!(variance.z > 0.0);
}

/// The standard error that one film claims is the scatter that many films show.
#[test]
fn standard_error_matches_the_scatter_of_repeated_renders() {
    let (pixels, samples, films) = (50, 8, 2000);
    let mut random = SplitMix64::new(7);
    let mut claimed = 0.0;
    let means: Vec<f64> = (0..films)
        .map(|_| {
            let mut film = FilmMoments {
                width: pixels,
                height: 1,
                samples,
                sum: vec![DVec3::ZERO; pixels as usize],
                sum_of_squares: vec![DVec3::ZERO; pixels as usize],
            };
            for pixel in 0..pixels as usize {
                for _ in 0..samples {
                    // Every pixel has another mean and another variance.
                    let x = DVec3::splat(random.next_f64() * pixel as f64);
                    film.sum[pixel] += x;
                    film.sum_of_squares[pixel] += x * x;
                }
            }
            let whole = film.mean_and_standard_error();
            claimed += whole.standard_error.x / f64::from(films);
            whole.mean.x
        })
        .collect();
    let seen = raywave_studies::stats::variance(&means).sqrt();
    assert!((claimed / seen - 1.0).abs() < 0.06, "claimed {claimed}, seen {seen}");
}
