//! Outputs that harm nothing, and work that no broken output costs: what docs/faults.md promises.
#![cfg(target_os = "linux")]

use std::fs::{self, File, Permissions};
use std::io::Read;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, chown, symlink};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread::{self, sleep};
use std::time::Duration;

use serde_json::Value;

use crate::command_line::{CAMERA, Folder, await_handler, text};
use crate::common::not_tested::not_tested;
use crate::common::project::program;
use raywave::image::read_image;

/// Commands that write the file `OUT`, with its extension.
const WRITERS: [(&str, &str); 8] = [
    ("render --width 9 --height 9 --samples 1 -o OUT", "exr"),
    (
        "compare --vary scheduler=bounce,megakernel --rounds 1 --no-counters --start-ups 0 --width 9 --height 9 \
         --samples 1 --json OUT",
        "json",
    ),
    ("tradeoff --budget 0.1s --rounds 1 --max-bounces 1 --width 9 --height 9 --samples 1 --json OUT", "json"),
    ("stability --quick --only gap --json OUT", "json"),
    ("replay good.rays --rounds 1 --json OUT", "json"),
    ("convert lamp.toml OUT", "toml"),
    ("dump-rays --bounce 0 --width 9 --height 9 --samples 1 -o OUT", "rays"),
    ("diff small.exr small.exr --heatmap OUT", "png"),
];

/// A tuning of a few rays. It writes to the folder of caches.
const TUNE: [&str; 9] = ["tune", "--rounds", "1", "--width", "8", "--height", "8", "--samples", "1"];

/// What the commands read.
fn inputs() -> Folder {
    let folder = Folder::new();
    folder.scene("lamp", CAMERA, "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n");
    folder.succeed(&words("dump-rays --bounce 0 --width 9 --height 9 --samples 1 --quiet -o good.rays"));
    folder
}

fn words(line: &str) -> Vec<&str> {
    line.split(' ').filter(|word| !word.is_empty()).collect()
}

/// A command's name, its arguments with another output, and that output.
fn writing_to(folder: &str) -> Vec<(&'static str, Vec<String>, String)> {
    let writer = |(line, extension): (&'static str, &str)| {
        let output = format!("{folder}-{}.{extension}", words(line)[0]);
        let arguments =
            words(line).into_iter().map(|word| if word == "OUT" { output.clone() } else { word.to_owned() });
        (words(line)[0], arguments.collect(), output.clone())
    };
    WRITERS.into_iter().map(writer).collect()
}

fn command(folder: &Folder, arguments: &[String]) -> Command {
    folder.command(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
}

fn run(folder: &Folder, arguments: &[String]) -> Output {
    command(folder, arguments).output().expect("the program starts")
}

/// That a command said in one line why it failed.
fn assert_refused(name: &str, output: &Output, part: &str) {
    let said = text(&output.stderr);
    let errors: Vec<_> = said.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!((output.status.code(), errors.len()), (Some(2), 1), "{name}: {said}");
    assert!(errors[0].contains(part) && said.ends_with(&format!("{}\n", errors[0])), "{name}: {said}");
}

fn temporaries(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder)
        .expect("the folder is there")
        .map(|entry| entry.expect("the folder is readable").file_name().into_string().expect("names are UTF-8"));
    names.filter(|name| name.starts_with(".raywave-")).collect()
}

/// A shell script as the superuser of mounts of its own; nothing where the system forbids them.
fn among_mounts(folder: &Folder, script: &str, arguments: &[String]) -> Option<Output> {
    let unshare = |flags: &str| {
        let mut command = Command::new("unshare");
        command.arg(flags).current_dir(folder.path("")).env("RAYWAVE_CACHE", "off");
        command
    };
    let can_mount = |flags: &&str| {
        let tried = unshare(flags).args(["sh", "-c", "mount -t tmpfs none /mnt"]).output();
        tried.is_ok_and(|output| output.status.success())
    };
    let flags = ["-m", "-rm"].into_iter().find(can_mount)?;
    Some(unshare(flags).args(["sh", "-c", script]).arg(program()).args(arguments).output().expect("a shell starts"))
}

#[test]
fn a_broken_stderr_costs_no_output() {
    let folder = inputs();
    let tune = TUNE.map(str::to_owned).to_vec();
    let all = writing_to("out").into_iter().chain([("tune", tune, String::new())]);
    for (name, arguments, output) in all {
        for broken in ["full", "left", "closed"] {
            let mut command = command(&folder, &arguments);
            command.stdout(Stdio::null());
            let status = match broken {
                "full" => {
                    let full = File::options().write(true).open("/dev/full").expect("it can be opened");
                    command.stderr(full).status()
                }
                "left" => {
                    let mut child = command.stderr(Stdio::piped()).spawn().expect("the program starts");
                    drop(child.stderr.take());
                    child.wait()
                }
                _ => {
                    let script = "exec \"$0\" \"$@\" >/dev/null 2>&-";
                    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
                    folder.shell(script, &arguments).status()
                }
            };
            assert_eq!(status.expect("it ends").code(), Some(0), "{name}, {broken}");
            if !output.is_empty() {
                let written = fs::read(folder.path(&output)).expect("the output is written");
                assert!(!written.is_empty(), "{name}, {broken}");
                fs::remove_file(folder.path(&output)).expect("it was just read");
            }
            if name == "tune" {
                break;
            }
        }
        // What cannot be said is no reason for another exit code either.
        let full = File::options().write(true).open("/dev/full").expect("it can be opened");
        let status = folder.command(&[name, "--unknown"]).stderr(full).status().expect("the program starts");
        assert_eq!(status.code(), Some(2), "{name}");
    }
}

#[test]
fn devices_stay_devices() {
    let folder = inputs();
    for (name, arguments, output) in writing_to("node") {
        // Of its own, since /dev/null would be gone for the whole machine.
        let made = Command::new("mknod").arg(folder.path(&output)).args(["c", "1", "3"]).output();
        let node = folder.path(&output);
        if !made.is_ok_and(|made| made.status.success()) || File::options().write(true).open(&node).is_err() {
            return not_tested("that device nodes are not replaced: this user cannot make one");
        }
        let ran = run(&folder, &arguments);
        assert!(ran.status.success(), "{name}: {}", text(&ran.stderr));
        let kind = fs::symlink_metadata(&node).expect("it is there").file_type();
        assert!(kind.is_char_device(), "{name} replaces the device");
        fs::remove_file(node).expect("it was just there");
    }
    // A device takes any number of outputs.
    let nowhere = "render --width 9 --height 9 --samples 1 -q -o /dev/null --stats /dev/null --trace /dev/null";
    folder.succeed(&words(nowhere));
    assert!(fs::metadata("/dev/null").expect("it is there").file_type().is_char_device());
}

#[test]
fn fifos_are_written_to() {
    let folder = inputs();
    for (name, arguments, output) in writing_to("fifo") {
        let made = Command::new("mkfifo").arg(folder.path(&output)).status().expect("mkfifo is there");
        assert!(made.success());
        let fifo = folder.path(&output);
        let reader = thread::spawn(move || {
            let mut bytes = Vec::new();
            File::open(fifo).and_then(|mut file| file.read_to_end(&mut bytes)).expect("the FIFO is readable");
            bytes
        });
        let ran = run(&folder, &arguments);
        assert!(ran.status.success(), "{name}: {}", text(&ran.stderr));
        // A reader of what was replaced would wait for ever.
        let kind = fs::symlink_metadata(folder.path(&output)).expect("it is there").file_type();
        assert!(kind.is_fifo(), "{name} replaces the FIFO");
        let read = reader.join().expect("the reader ends");
        assert!(!read.is_empty(), "{name}");
        if ["render", "dump-rays", "diff"].contains(&name) {
            fs::remove_file(folder.path(&output)).expect("it was just there");
            run(&folder, &arguments);
            assert!(fs::read(folder.path(&output)).expect("it is written") == read, "{name}: other bytes");
        }
    }
}

#[test]
fn links_permissions_and_owners_stay() {
    let folder = inputs();
    fs::create_dir(folder.path("there")).expect("a folder");
    for (name, arguments, output) in writing_to("link") {
        let [link, target] = [folder.path(&output), folder.path("there").join(&output)];
        symlink(Path::new("there").join(&output), &link).expect("a link");
        // At first it leads nowhere.
        for turn in ["new", "old"] {
            let ran = run(&folder, &arguments);
            assert!(ran.status.success(), "{name}: {}", text(&ran.stderr));
            assert!(fs::symlink_metadata(&link).expect("it is there").is_symlink(), "{name} replaces the link");
            let found = fs::metadata(&target).expect("the target is written");
            assert!(found.is_file() && found.len() > 3, "{name}");
            if turn == "new" {
                fs::write(&target, "old").expect("it can be written");
                // The superuser may give files away.
                let _ = chown(&target, Some(1), Some(1));
                fs::set_permissions(&target, Permissions::from_mode(0o640)).expect("it is one's own");
            } else {
                assert_eq!(found.mode() & 0o7777, 0o640, "{name}");
                let may_give = fs::metadata(folder.path("there")).expect("it is there").uid() == 0;
                assert!(!may_give || (found.uid(), found.gid()) == (1, 1), "{name}");
            }
        }
        assert!(temporaries(&folder.path("there")).is_empty(), "{name}");
    }
    // Two names of one output.
    let twice = folder.run(&words("render --width 9 --height 9 -o a.exr --stats there/link-render.exr -q"));
    assert!(twice.status.success());
    let twice = folder.run(&words("render --width 9 --height 9 -o link-render.exr --stats there/link-render.exr -q"));
    assert_refused("render", &twice, "--stats and --output name the same file");
}

#[test]
fn read_only_files_and_folders_are_refused_at_once() {
    let folder = inputs();
    folder.write("locked.exr", "old");
    fs::set_permissions(folder.path("locked.exr"), Permissions::from_mode(0o444)).expect("it is one's own");
    if File::options().write(true).open(folder.path("locked.exr")).is_ok() {
        not_tested("that a read-only file is not replaced: this user may write it all the same");
    } else {
        let ran = folder.run(&words("render --width 9 --height 9 -o locked.exr"));
        assert_refused("render", &ran, "ermission denied");
        assert_eq!(fs::read(folder.path("locked.exr")).expect("it is there"), b"old");
    }
    fs::create_dir(folder.path("mount")).expect("a folder");
    for (name, arguments, _) in writing_to("mount/a") {
        let script = "mount -t tmpfs -o ro none mount && exec \"$0\" \"$@\"";
        let Some(ran) = among_mounts(&folder, script, &arguments) else {
            return not_tested("read-only folders: this user cannot mount one");
        };
        assert_refused(name, &ran, "Read-only file system");
    }
}

#[test]
fn a_full_disk_leaves_the_old_file() {
    let folder = inputs();
    fs::create_dir(folder.path("mount")).expect("a folder");
    let script = "mount -t tmpfs -o size=64k none mount; echo old > $OUT; cat /dev/zero > mount/fill 2>&-; \
                  \"$0\" \"$@\"; code=$?; { ls -A mount; cat $OUT; } > seen; exit $code";
    let tune = TUNE.map(str::to_owned).to_vec();
    for (name, arguments, output) in
        writing_to("mount/a").into_iter().chain([("tune", tune, "mount/a-tune".to_owned())])
    {
        // `tune` writes to the folder of caches, and prints what it found in any case. Mesa's own cache dies of a full disk.
        let cache = if name == "tune" {
            "export MESA_SHADER_CACHE_DISABLE=true XDG_CACHE_HOME=$PWD/mount; unset RAYWAVE_CACHE;"
        } else {
            ""
        };
        let script = format!("{cache} OUT={output}; {script}");
        let Some(ran) = among_mounts(&folder, &script, &arguments) else {
            return not_tested("full disks: this user cannot mount one");
        };
        assert_refused(name, &ran, "No space left on device");
        let seen = fs::read_to_string(folder.path("seen")).expect("the script ends");
        let name_there = output.trim_start_matches("mount/");
        let folder_there = if name == "tune" { "raywave\n" } else { "" };
        assert_eq!(seen, format!("{name_there}\nfill\n{folder_there}old\n"), "{name}");
        assert!(name != "tune" || text(&ran.stdout).contains("\nchosen  "), "{}", text(&ran.stdout));
    }
}

#[test]
fn a_full_stdout_is_told_and_one_that_is_left_is_not() {
    let folder = inputs();
    let tiny = "--width 9 --height 9 --samples 1 -q";
    for line in [
        "info".to_owned(),
        "diff small.exr small.exr".to_owned(),
        format!("render {tiny} -o -"),
        format!("render {tiny} -o a.exr --stats -"),
        "replay good.rays --rounds 1 --json -".to_owned(),
        "stability --quick --only gap -q --json -".to_owned(),
    ] {
        let full = File::options().write(true).open("/dev/full").expect("it can be opened");
        let ran = folder.command(&words(&line)).stdout(full).output().expect("the program starts");
        assert_refused(&line, &ran, "No space left on device");

        let mut child =
            folder.command(&words(&line)).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        drop(child.stdout.take());
        let left = child.wait_with_output().expect("it ends");
        if line.ends_with("-o -") {
            // An image that nobody got is not silently lost.
            assert_refused(&line, &left, "Broken pipe");
        } else {
            assert!(left.status.success() && left.stderr.is_empty(), "{line}: {}", text(&left.stderr));
        }
    }
}

#[test]
fn a_dash_is_stdout() {
    let folder = inputs();
    let piped = |line: &str| {
        let ran = folder.run(&words(line));
        assert!(ran.status.success(), "{line}: {}", text(&ran.stderr));
        ran.stdout
    };
    let tiny = "--width 9 --height 9 --samples 1";
    for (format, name) in
        [("", "a.exr"), ("--format png", "a.png"), ("--format hdr", "a.hdr"), ("--format exr", "a.exr")]
    {
        piped(&format!("render {tiny} -o {name}"));
        let file = fs::read(folder.path(name)).expect("it is written");
        assert!(piped(&format!("render {tiny} {format} -o -")) == file, "{name}");
        assert!(piped(&format!("render {tiny} {format} -o /dev/stdout")) == file, "{name}");
        assert!(piped(&format!("render {tiny} {format} -o /proc/self/fd/1")) == file, "{name}");
    }
    piped(&format!("render {tiny} --format png -o named.exr"));
    assert!(fs::read(folder.path("named.exr")).expect("it is written").starts_with(b"\x89PNG"), "--format comes first");
    assert!(!folder.path("-").exists());

    // Whatever else a shell puts into that file stays.
    let script = "{ echo before; \"$0\" \"$@\"; echo after; } > both";
    let arguments = words("render --width 9 --height 9 --samples 1 -q -o -");
    let ran = folder.shell(script, &arguments).status().expect("a shell starts");
    assert!(ran.success());
    let image = fs::read(folder.path("a.exr")).expect("it is written");
    let both = [b"before\n", &image[..], b"after\n"].concat();
    assert!(fs::read(folder.path("both")).expect("it is written") == both);

    // JSON stands in for the table.
    let reports = writing_to("-").into_iter().filter(|(_, arguments, _)| arguments.iter().any(|word| word == "--json"));
    let reports = reports.map(|(_, arguments, output)| arguments.join(" ").replace(&output, "-"));
    for line in reports.chain([format!("render {tiny} -o a.exr --stats -"), "selftest --only add --json -".into()]) {
        let json = piped(&line);
        assert!(serde_json::from_slice::<Value>(&json).is_ok_and(|json| json.is_object()), "{line}: {}", text(&json));
    }
    let ran = folder.run(&words(&format!("render {tiny} -o - --stats -")));
    assert_refused("render", &ran, "--stats and --output name the same file");
    let ran = folder.run(&words("compare --json - --csv /dev/stdout"));
    assert_refused("compare", &ran, "two reports cannot be one file");
}

fn signal(name: &str, child: &Child) {
    let killed = Command::new("kill").args(["-s", name, &child.id().to_string()]).status().expect("kill runs");
    assert!(killed.success());
}

#[test]
fn who_is_asked_to_end_writes_what_is_done() {
    let folder = Folder::new();
    let endless = words("render --width 32 --height 32 --samples 16777216 --in-flight 4096 -o box.exr");
    for name in ["INT", "TERM", "HUP"] {
        let mut child = folder.command(&endless).stderr(Stdio::piped()).spawn().expect("the program starts");
        await_handler(&mut child);
        sleep(Duration::from_millis(300));
        signal(name, &child);
        let output = child.wait_with_output().expect("the render ends");
        assert_eq!(output.status.code(), Some(0), "{name}: {}", text(&output.stderr));
        let image = read_image(&folder.path("box.exr")).expect("the image is written");
        assert!(image.pixels[0].is_finite(), "{name}");
        fs::remove_file(folder.path("box.exr")).expect("it was just read");
    }

    // As `nohup` starts it: the terminal's end is not the render's.
    let mut command = folder.shell("trap '' HUP; exec \"$0\" \"$@\"", &endless);
    let mut child = command.stderr(Stdio::null()).spawn().expect("a shell starts");
    await_handler(&mut child);
    sleep(Duration::from_millis(300));
    signal("HUP", &child);
    sleep(Duration::from_millis(1000));
    assert!(child.try_wait().expect("the child can be asked").is_none(), "it ends with its terminal");
    signal("TERM", &child);
    assert!(child.wait().expect("the render ends").success());
    assert!(folder.path("box.exr").exists());
}

#[test]
fn studies_that_are_asked_to_end_keep_their_renders() {
    let folder = Folder::new();
    let study = "--width 8 --height 8 --samples 1 --max-bounces 1 --json a.json -q";
    for (line, name) in [
        (format!("compare --rounds 1000000 --no-counters --start-ups 0 {study}"), "TERM"),
        (format!("tradeoff --budget 1000h --rounds 1000000 {study}"), "HUP"),
        ("stability --json a.json -q".to_owned(), "INT"),
    ] {
        let mut command = folder.command(&words(&line));
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts");
        await_handler(&mut child);
        while !folder.path("a.json").exists() {
            assert!(child.try_wait().expect("the child can be asked").is_none(), "{line} ends too early");
            sleep(Duration::from_millis(20));
        }
        signal(name, &child);
        let output = child.wait_with_output().expect("it ends");
        assert_eq!(output.status.code(), Some(0), "{line}: {}", text(&output.stderr));
        let json = fs::read(folder.path("a.json")).expect("it is written");
        let json: Value = serde_json::from_slice(&json).expect("it is whole");
        assert!(json.is_object(), "{line}");
        fs::remove_file(folder.path("a.json")).expect("it was just read");
    }
}

#[test]
fn leftovers_of_the_dead_go_and_those_of_the_living_stay() {
    let folder = Folder::new();
    let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").expect("Linux tells it");
    let own = format!(".raywave-{}-", boot.trim());
    let names =
        [format!("{own}dead"), format!("{own}alive"), format!("{own}link"), ".raywave-elsewhere-dead".to_owned()];
    let [dead, alive, link, elsewhere] = &names;
    for name in [dead, alive, elsewhere] {
        folder.write(name, "half an image");
    }
    symlink(folder.path("small.exr"), folder.path(link)).expect("a link");
    let held = File::open(folder.path(alive)).expect("it was just written");
    held.try_lock().expect("nobody else has it");
    folder.succeed(&words("render --width 9 --height 9 --samples 1 -q -o a.exr"));
    assert!(!folder.path(dead).exists(), "a leftover stays");
    for name in [alive, link, elsewhere] {
        assert!(fs::symlink_metadata(folder.path(name)).is_ok(), "{name} is not raywave's to remove");
    }
    drop(held);
    folder.succeed(&words("render --width 9 --height 9 --samples 1 -q -o a.exr"));
    assert!(!folder.path(alive).exists(), "a leftover stays");
}
