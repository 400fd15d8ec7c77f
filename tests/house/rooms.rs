//! The rules of ARCHITECTURE.md that can be read off the sources: which room may use which,
//! where Vulkan and `unsafe` are, and who prints.

use std::fs;
use std::path::{Path, PathBuf};

use crate::project::project_file;

/// Every room of `src/` and the rooms that it may use, as the table of ARCHITECTURE.md has them.
fn rooms() -> Vec<(String, Vec<String>)> {
    let text = fs::read_to_string(project_file("ARCHITECTURE.md")).expect("the map is text");
    let table = text.split_once("| room | owns | may use |\n|---|---|---|\n").expect("it has the table of rooms").1;
    let names = |cell: &str| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    let row = |line: &str| {
        let cells: Vec<&str> = line.trim_matches('|').split(" | ").collect();
        let [room, _, uses] = cells[..] else { panic!("three cells, not {line}") };
        (names(room).remove(0), names(uses))
    };
    let rooms: Vec<_> = table.lines().take_while(|line| line.starts_with('|')).map(row).collect();
    assert!(rooms.len() > 20, "the table was read");
    rooms
}

/// What binds the rooms together, and knows all of them.
const DOORS: [&str; 2] = ["lib", "main"];

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

    /// Rooms that the line names by their crate. What is no room begins with a capital.
    fn uses(&self) -> impl Iterator<Item = &str> {
        let own = if ["spirv", "cli"].contains(&&*self.room) { None } else { Some("crate::") };
        let spirv = self.has("raywave_shaders").then_some("spirv");
        let crates = ["raywave::", "raywave_studies::"].into_iter().chain(own);
        let names = crates.flat_map(|name| self.code.split(name).skip(1)).map(|rest| {
            let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            &rest[..end]
        });
        names.filter(|name| name.starts_with(|c: char| c.is_ascii_lowercase())).chain(spirv)
    }
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let paths =
        fs::read_dir(folder).expect("the folder is readable").map(|entry| entry.expect("so is the entry").path());
    let files = |path: PathBuf| if path.is_dir() { rust_files(&path) } else { vec![path] };
    paths.flat_map(files).filter(|path| path.extension().is_some_and(|extension| extension == "rs")).collect()
}

/// Where the sources of each crate are. The first and the last are one room each.
const SOURCES: [(&str, Option<&str>); 4] = [
    ("crates/shaders/src", Some("spirv")),
    ("src", None),
    ("crates/studies/src", None),
    ("crates/cli/src", Some("cli")),
];

fn sources() -> Vec<Line> {
    let mut lines = Vec::new();
    for (folder, whole) in SOURCES {
        let src = project_file(folder);
        for path in rust_files(&src) {
            let name = path.strip_prefix(&src).expect("it lies there").to_string_lossy().into_owned();
            let room = whole.unwrap_or_else(|| name.split(['/', '\\', '.']).next().expect("a name has a start"));
            let text = fs::read_to_string(&path).expect("sources are text");
            lines.extend(text.lines().enumerate().map(|(index, line)| Line {
                room: room.to_owned(),
                place: format!("{folder}/{name}:{}", index + 1),
                code: line.split("//").next().unwrap_or_default().to_owned(),
            }));
        }
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
    let rooms = rooms();
    let may = |room: &str, used: &str| {
        rooms.iter().any(|(name, uses)| name == room && uses.iter().any(|allowed| allowed == used))
    };
    assert_none("a room that its neighbour may not use, by the table of ARCHITECTURE.md", |line| {
        !DOORS.contains(&&*line.room) && line.uses().any(|used| used != line.room && !may(&line.room, used))
    });
}

#[test]
fn the_map_has_every_room_and_no_arrow_too_many() {
    let rooms = rooms();
    let lines = sources();
    let is_room = |name: &str| rooms.iter().any(|(room, _)| room == name);
    assert_none("a room that ARCHITECTURE.md does not list", |line| {
        !DOORS.contains(&&*line.room) && !is_room(&line.room)
    });
    for (room, uses) in &rooms {
        for used in uses {
            let is = lines.iter().any(|line| line.room == *room && line.uses().any(|name| name == used));
            assert!(is, "`{room}` may use `{used}` by ARCHITECTURE.md, and does not");
        }
    }
}

#[test]
fn vulkan_and_unsafe_code_stay_in_gpu() {
    assert_none("Vulkan or unsafe code outside src/gpu", |line| {
        line.room != "gpu" && ["ash", "gpu_allocator", "unsafe", "unsafe_code"].iter().any(|word| line.has(word))
    });
}

#[test]
fn of_render_only_session_and_replay_run_anything() {
    assert_none("an executor in src/render outside session and replay", |line| {
        let runs =
            ["session.rs", "replay.rs"].iter().any(|file| line.place.starts_with(&format!("src/render/{file}:")));
        line.room == "render" && !runs && ["executor", "Executor"].iter().any(|word| line.has(word))
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
    let printers = ["print!", "println!", "eprint!", "eprintln!", "dbg!", "io::stdout", "io::stderr"];
    // A file may be written to /dev/stdout.
    let is_allowed = |line: &Line, word| line.room == "cli" || (&*line.room, word) == ("whole_file", "io::stdout");
    assert_none("output outside crates/cli", |line| {
        let prints = |word: &&str| line.has(word.trim_end_matches('!')) && line.code.contains(*word);
        printers.iter().filter(|word| prints(word)).any(|word| !is_allowed(line, word))
    });
}
