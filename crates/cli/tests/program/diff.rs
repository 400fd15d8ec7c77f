//! `raywave diff`: what it prints, what it paints, and what it refuses.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Parser;
use glam::{Vec3, vec3};
use raywave::image::{Image, WriteOptions, write_image};
use raywave_cli::diff::{DiffArguments, HeatmapScale, diff, run};
use tempfile::TempDir;

#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    diff: DiffArguments,
}

/// A folder with images, and the arguments to compare `a.exr` with `b.exr` in it.
struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new(a: &Image, b: &Image) -> Self {
        let bench = Self { folder: tempfile::tempdir().unwrap() };
        for (name, image) in [("a.exr", a), ("b.exr", b)] {
            write_image(&bench.path(name), image, &WriteOptions::default()).unwrap();
        }
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn arguments(&self, more: &[&str]) -> DiffArguments {
        let (a, b) = (self.path("a.exr"), self.path("b.exr"));
        let files = ["raywave".into(), a.into_os_string(), b.into_os_string()];
        Cli::parse_from(files.into_iter().chain(more.iter().map(Into::into))).diff
    }

    /// The report, and the heatmap if one was asked for at `heatmap.png`.
    fn heatmap(&self, scale: HeatmapScale) -> (String, Vec<[u8; 3]>) {
        let path = self.path("heatmap.png");
        let mut arguments = self.arguments(&["--heatmap", path.to_str().unwrap()]);
        arguments.scale = scale;
        let report = diff(&arguments).unwrap().to_string();
        let image = image::open(path).unwrap().to_rgb8();
        (report, image.pixels().map(|pixel| pixel.0).collect())
    }
}

fn image(pixels: &[Vec3]) -> Image {
    Image::new(pixels.len() as u32, 1, pixels.to_vec())
}

fn black(pixels: usize) -> Image {
    image(&vec![Vec3::ZERO; pixels])
}

fn files_in(folder: &Path) -> usize {
    fs::read_dir(folder).unwrap().count()
}

/// The words of the line that begins with `name`, after it.
fn line(report: &str, name: &str) -> Vec<String> {
    let found = report.lines().find(|line| line.split_whitespace().next() == Some(name));
    let line = found.unwrap_or_else(|| panic!("no line {name} in\n{report}"));
    line.split_whitespace().skip(1).map(Into::into).collect()
}

fn number(report: &str, name: &str) -> f64 {
    line(report, name)[0].parse().unwrap()
}

#[test]
fn the_report_holds_every_figure() {
    let a = image(&[vec3(1.0, 2.0, 0.0), vec3(3.0, 2.0, 0.0), Vec3::NAN]);
    let b = image(&[vec3(1.0, 1.0, 0.0), vec3(1.0, 1.0, 0.0), Vec3::INFINITY]);
    let bench = Bench::new(&a, &b);
    let report = diff(&bench.arguments(&[])).unwrap().to_string();

    assert_eq!(line(&report, "a"), [bench.path("a.exr").to_str().unwrap()]);
    assert_eq!(line(&report, "b"), [bench.path("b.exr").to_str().unwrap()]);
    assert_eq!(line(&report, "size").join(" "), "3 x 1");
    assert_eq!(line(&report, "compared_pixels").join(" "), "2 of 3");
    assert_eq!(line(&report, "identical_pixels").join(" "), "0 of 3, to the last bit");
    assert_eq!(line(&report, "non_finite_a").join(" "), "1 nan, 0 inf");
    assert_eq!(line(&report, "non_finite_b").join(" "), "0 nan, 1 inf");
    for (name, value) in [
        ("mse", 1.0),
        ("rel_mse", 1.0 / 1.01),
        ("mean_a", 4.0 / 3.0),
        ("mean_b", 2.0 / 3.0),
        ("mean_difference", 2.0 / 3.0),
        ("standard_error", 1.0 / 3.0),
        ("z", 2.0),
        ("p", 0.0455),
        ("max_abs_difference", 2.0),
    ] {
        let printed = number(&report, name);
        assert!((printed / value - 1.0).abs() < 1e-4, "{name} {printed}");
    }
    assert!(!report.contains("heatmap"));
}

#[test]
fn values_stand_in_one_column() {
    let bench = Bench::new(&image(&[vec3(1.0, 2.0, 3.0)]), &image(&[Vec3::ONE]));
    let report = diff(&bench.arguments(&["--channels"])).unwrap().to_string();
    for line in report.lines().take(7) {
        assert!(line[..20].ends_with(' ') && !line[20..].starts_with(' '), "{line}");
    }
    let rows: Vec<&str> = report.lines().skip(7).collect();
    assert_eq!(rows[0].split_whitespace().collect::<Vec<_>>(), ["all", "red", "green", "blue"]);
    assert!(rows.iter().all(|row| row.len() == rows[0].len()), "{report}");
    let mse: Vec<f64> = line(&report, "mse").iter().map(|v| v.parse().unwrap()).collect();
    assert_eq!(mse[1..], [0.0, 1.0, 4.0]);
}

#[test]
fn json_says_the_same() {
    let bench = Bench::new(&image(&[vec3(1.0, 2.0, 0.0); 2]), &image(&[Vec3::ONE; 2]));
    let path = bench.path("heatmap.png");
    let report = diff(&bench.arguments(&["--json", "--heatmap", path.to_str().unwrap()])).unwrap();
    let json: serde_json::Value = serde_json::to_value(&report).unwrap();
    assert_eq!(json["a"], bench.path("a.exr").to_str().unwrap());
    assert_eq!(json["width"], 2);
    assert_eq!(json["identical_pixels"], 0);
    assert_eq!(json["share_of_differing_pixels"], 1.0);
    assert_eq!(json["non_finite_a"]["nan_count"], 0);
    assert_eq!(json["whole"]["mse"], 2.0 / 3.0);
    assert_eq!(json["channels"][2]["mean_difference"], -1.0);
    // A certain difference: z is infinite, which JSON cannot say.
    assert!(json["channels"][1]["z"].is_null());
    assert_eq!(json["channels"][1]["p"], 0.0);
    assert_eq!(json["heatmap"]["scale"], "relative");
    assert_eq!(json["heatmap"]["high"], 0.0);
    assert_eq!(json["heatmap"]["path"], path.to_str().unwrap());
}

#[test]
fn a_file_equals_itself() {
    let bench = Bench::new(&image(&[Vec3::ONE; 4]), &image(&[Vec3::ONE; 4]));
    for b in ["a.exr", "b.exr"] {
        let mut arguments = bench.arguments(&[]);
        arguments.b = bench.path(b);
        let report = diff(&arguments).unwrap().to_string();
        assert_eq!(number(&report, "mse"), 0.0);
        assert_eq!(number(&report, "z"), 0.0);
        assert_eq!(number(&report, "p"), 1.0);
        assert_eq!(line(&report, "identical_pixels").join(" "), "4 of 4, to the last bit");
    }
    // No error has no range; the map is its darkest colour all over.
    for scale in [HeatmapScale::Relative, HeatmapScale::Absolute] {
        let (_, colours) = bench.heatmap(scale);
        assert_eq!(colours, [[0, 0, 0]; 4].map(|_| colours[0]));
        assert!(colours[0].iter().all(|&c| c < 10), "{colours:?}");
    }
}

#[test]
fn formats_mix() {
    let bench = Bench::new(&image(&[vec3(1.0, 0.5, 0.0)]), &image(&[Vec3::ONE]));
    for name in ["same.hdr", "same.png"] {
        let path = bench.path(name);
        write_image(&path, &image(&[vec3(1.0, 0.5, 0.0)]), &WriteOptions::default()).unwrap();
        let mut arguments = bench.arguments(&[]);
        arguments.b = path;
        assert!(number(&diff(&arguments).unwrap().to_string(), "max_abs_difference") < 0.01);
    }
}

#[test]
fn sizes_that_differ_are_told() {
    let bench = Bench::new(&image(&[Vec3::ONE; 2]), &image(&[Vec3::ONE; 3]));
    let path = bench.path("heatmap.png");
    let error = run(&bench.arguments(&["--heatmap", path.to_str().unwrap()])).unwrap_err();
    let message = format!("{error:#}");
    for part in ["a.exr", "b.exr", "2 x 1", "3 x 1"] {
        assert!(message.contains(part), "{message}");
    }
    assert!(!path.exists());
}

#[test]
fn heatmaps_that_cannot_be_written_are_refused_before_reading() {
    let bench = Bench::new(&image(&[Vec3::ONE]), &image(&[Vec3::ONE]));
    let before = files_in(bench.folder.path());
    for (name, part) in [("heat.jpg", "unknown image format"), ("missing/heat.png", "create it")] {
        let path = bench.path(name);
        let mut arguments = bench.arguments(&["--heatmap", path.to_str().unwrap()]);
        // Were the images read first, their absence would be the error.
        arguments.a = bench.path("no.exr");
        let message = format!("{:#}", run(&arguments).unwrap_err());
        assert!(message.contains(part), "{message}");
    }
    assert_eq!(files_in(bench.folder.path()), before);
}

#[test]
fn missing_images_are_named() {
    let bench = Bench::new(&image(&[Vec3::ONE]), &image(&[Vec3::ONE]));
    let mut arguments = bench.arguments(&[]);
    arguments.b = bench.path("no.exr");
    let message = format!("{:#}", run(&arguments).unwrap_err());
    assert!(message.contains("no.exr"), "{message}");
}

/// Perceived lightness grows with luminance.
fn luminance(colour: [u8; 3]) -> f64 {
    let linear = colour.map(|code| raywave::image::srgb::decode(f64::from(code) / 255.0));
    0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
}

#[test]
fn larger_errors_are_lighter() {
    // A ramp of errors, each a little larger than the one before.
    let linear: Vec<Vec3> = (0..64).map(|i| Vec3::splat(i as f32)).collect();
    let (report, colours) = Bench::new(&image(&linear), &black(64)).heatmap(HeatmapScale::Absolute);
    assert!(colours.windows(2).all(|pair| luminance(pair[0]) < luminance(pair[1])));
    let heatmap = line(&report, "heatmap").join(" ");
    assert!(heatmap.ends_with(": |a - b|, 0 black to 63 yellow"), "{heatmap}");
    // The ends of matplotlib's table, within the error of the fit.
    for (index, expected) in [(0, [0, 0, 4]), (63, [252, 255, 164])] {
        for (code, expected) in colours[index].into_iter().zip(expected) {
            assert!((i32::from(code) - expected).abs() <= 8, "{:?}", colours[index]);
        }
    }

    // (a - b)² / 0.01 from 1e-8 up by a decade for every two steps: six decades are twelve steps.
    let decades: Vec<Vec3> = (0..21).map(|i| Vec3::splat(1e-5 * 10f32.powf(i as f32 / 4.0) * 0.999)).collect();
    let (report, colours) = Bench::new(&image(&decades), &black(21)).heatmap(HeatmapScale::Relative);
    let brighter = |pair: &[[u8; 3]]| luminance(pair[0]) < luminance(pair[1]);
    let rising = colours.windows(2).filter(|pair| brighter(pair)).count();
    assert_eq!(rising, 12, "{colours:?}");
    let heatmap = line(&report, "heatmap").join(" ");
    assert!(heatmap.contains("log10") && heatmap.ends_with(", -4 black to 2 yellow"), "{heatmap}");
}

#[test]
fn pixels_that_are_not_finite_stand_out() {
    let a = image(&[Vec3::ONE, vec3(0.0, f32::NAN, 0.0), Vec3::ONE]);
    let b = image(&[Vec3::ZERO, Vec3::ZERO, vec3(f32::INFINITY, 0.0, 0.0)]);
    for scale in [HeatmapScale::Relative, HeatmapScale::Absolute] {
        let (_, colours) = Bench::new(&a, &b).heatmap(scale);
        assert_eq!(colours[1..], [[0, 255, 0]; 2]);
        assert_ne!(colours[0], [0, 255, 0]);
    }
}

#[test]
fn a_scale_without_a_heatmap_is_a_usage_error() {
    assert!(Cli::try_parse_from(["raywave", "a", "b", "--scale", "absolute"]).is_err());
    let cli = Cli::try_parse_from(["raywave", "a", "b", "--heatmap", "h.png", "--scale", "absolute"]);
    assert_eq!(cli.map(|cli| cli.diff.scale).ok(), Some(HeatmapScale::Absolute));
}
