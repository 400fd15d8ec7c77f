//! The rules of ARCHITECTURE.md that can be read off the sources: which room may use which,
//! where Vulkan and `unsafe` are, and who prints.

#[path = "common/project.rs"]
mod project;

use std::fs;
use std::path::{Path, PathBuf};

use project::project_file;

/// Every room of `src/` and the rooms that it may use.
const ROOMS: &[(&str, &[&str])] = &[
    ("alias", &[]),
    ("bvh", &["constants", "layout"]),
    (
        "cli",
        &[
            "bvh",
            "clocks",
            "constants",
            "export",
            "facts",
            "film",
            "gallery",
            "gpu",
            "image",
            "layout",
            "rays",
            "render",
            "scene",
            "selftest",
            "stability",
            "stats",
            "studies",
            "trace",
            "whole_file",
        ],
    ),
    ("clocks", &[]),
    ("constants", &[]),
    ("export", &["image", "stats", "studies", "whole_file"]),
    ("facts", &["constants", "gpu", "layout", "recording", "shaders", "whole_file"]),
    ("film", &["image"]),
    ("gallery", &["image", "scene", "whole_file"]),
    ("gpu", &["recording", "shaders", "trace", "whole_file"]),
    ("image", &["whole_file"]),
    ("layout", &["constants"]),
    ("lib", &[]),
    ("main", &[]),
    ("oracle", &["render", "scene"]),
    ("rays", &["constants", "whole_file"]),
    ("recording", &["layout"]),
    (
        "render",
        &[
            "alias",
            "bvh",
            "constants",
            "facts",
            "film",
            "gpu",
            "image",
            "layout",
            "rays",
            "recording",
            "scene",
            "shaders",
            "trace",
        ],
    ),
    ("scene", &["image", "whole_file"]),
    (
        "selftest",
        &[
            "bvh",
            "constants",
            "gpu",
            "image",
            "layout",
            "oracle",
            "recording",
            "render",
            "scene",
            "shaders",
            "stability",
            "stats",
        ],
    ),
    ("shaders", &[]),
    ("stability", &["bvh", "constants", "film", "gpu", "oracle", "rays", "render", "scene", "stats", "studies"]),
    ("stats", &["image"]),
    ("studies", &["clocks", "image", "stats"]),
    ("trace", &[]),
    ("whole_file", &[]),
];

/// A line of code without its comment.
struct Line {
    room: String,
    place: String,
    code: String,
}

impl Line {
    /// Whether `word` stands in the code with no letter, digit or underscore on either side.
    fn has(&self, word: &str) -> bool {
        let joins = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
        self.code.match_indices(word).any(|(at, _)| {
            let after = &self.code[at + word.len()..];
            !joins(self.code[..at].chars().next_back()) && !joins(after.chars().next())
        })
    }

    /// Rooms that the line names by `crate::`.
    fn uses(&self) -> impl Iterator<Item = &str> {
        self.code.split("crate::").skip(1).map(|rest| {
            let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            &rest[..end]
        })
    }
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let paths =
        fs::read_dir(folder).expect("the folder is readable").map(|entry| entry.expect("so is the entry").path());
    let files = |path: PathBuf| if path.is_dir() { rust_files(&path) } else { vec![path] };
    paths.flat_map(files).filter(|path| path.extension().is_some_and(|extension| extension == "rs")).collect()
}

fn sources() -> Vec<Line> {
    let src = project_file("src");
    let mut lines = Vec::new();
    for path in rust_files(&src) {
        let name = path.strip_prefix(&src).expect("it lies in src").to_string_lossy().into_owned();
        let room = name.split(['/', '\\', '.']).next().expect("a name has a start").to_owned();
        let text = fs::read_to_string(&path).expect("sources are text");
        lines.extend(text.lines().enumerate().map(|(index, line)| Line {
            room: room.clone(),
            place: format!("src/{name}:{}", index + 1),
            code: line.split("//").next().unwrap_or_default().to_owned(),
        }));
    }
    assert!(lines.len() > 1000, "the sources were found");
    lines
}

/// Fails with every line for which `is_wrong` holds.
fn assert_none(rule: &str, is_wrong: impl Fn(&Line) -> bool) {
    let lines = sources();
    let wrong: Vec<_> =
        lines.iter().filter(|line| is_wrong(line)).map(|l| format!("{}: {}", l.place, l.code)).collect();
    assert!(wrong.is_empty(), "{rule}:\n{}", wrong.join("\n"));
}

#[test]
fn rooms_use_only_the_rooms_they_may() {
    assert_none("a room that its neighbour may not use (see ROOMS)", |line| {
        let allowed = ROOMS.iter().find(|(room, _)| *room == line.room).map(|(_, allowed)| *allowed);
        line.uses().any(|used| used != line.room && !allowed.is_some_and(|allowed| allowed.contains(&used)))
    });
}

#[test]
fn every_room_is_in_the_table() {
    assert_none("a room that ROOMS does not list", |line| ROOMS.iter().all(|(room, _)| *room != line.room));
}

#[test]
fn vulkan_and_unsafe_code_stay_in_gpu() {
    assert_none("Vulkan or unsafe code outside src/gpu", |line| {
        line.room != "gpu" && ["ash", "gpu_allocator", "unsafe", "unsafe_code"].iter().any(|word| line.has(word))
    });
}

#[test]
fn image_formats_stay_in_image() {
    let codecs = ["exr::", "png::", "image::codecs", "DynamicImage", "ImageReader", "RgbImage"];
    assert_none("an image format outside src/image", |line| {
        line.room != "image" && codecs.iter().any(|codec| line.code.contains(codec))
    });
}

#[test]
fn the_command_line_alone_prints() {
    let printers = ["print!", "println!", "eprint!", "eprintln!", "dbg!", "stdout", "stderr"];
    assert_none("output outside src/cli", |line| {
        line.room != "cli"
            && printers.iter().any(|word| line.has(word.trim_end_matches('!')) && line.code.contains(word))
    });
}
