//! Films: what `render` keeps, goes on from and is put together from, as docs/film.md says.
#![cfg(target_os = "linux")]

use std::fs;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::command_line::{CAMERA, Folder, text};

/// A scene and its size, and the blocks of a render.
const SCENE: &str = "render lamp.toml --height 30";
const RENDER: &str = "render lamp.toml --height 30 --width 40 --samples 52 --block-samples 8 --integrator mis";
const ENDLESS: &str = "render lamp.toml --height 30 --width 40 --samples 16000000 --block-samples 8 --keep-every 1ms";

fn inputs() -> Folder {
    let folder = Folder::new();
    folder.scene("lamp", CAMERA, "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n");
    folder
}

fn words(line: &str) -> Vec<&str> {
    line.split(' ').filter(|word| !word.is_empty()).collect()
}

fn read(folder: &Folder, name: &str) -> Vec<u8> {
    fs::read(folder.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn succeed(folder: &Folder, line: &str) -> String {
    folder.succeed(&words(line))
}

/// Images, or films, whose pixels must have the same bits.
fn assert_same(folder: &Folder, a: &str, b: &str) {
    let told: Value = serde_json::from_str(&succeed(folder, &format!("diff {a} {b} --json"))).expect("it is JSON");
    assert_eq!(told["identical_pixels"], told["compared_pixels"], "{a} and {b}: {told}");
    let size = |side: &str| told[side].as_u64().expect("a number");
    assert_eq!(told["compared_pixels"], size("width") * size("height"), "{a} and {b}: {told}");
}

/// What a command that must fail says in its one line.
fn refused(folder: &Folder, line: &str) -> String {
    let output = folder.run(&words(line));
    let said = text(&output.stderr);
    assert_eq!((output.status.code(), said.lines().count()), (Some(2), 1), "{line}: {said}");
    said
}

#[test]
fn parts_make_the_file_that_one_render_makes() {
    let folder = inputs();
    succeed(&folder, &format!("{RENDER} -o whole.exr"));
    succeed(&folder, &format!("{RENDER} --film whole.film -o of_film.exr"));
    assert_same(&folder, "of_film.exr", "whole.exr");
    let schedulers = ["wavefront", "bounce", "megakernel"];
    for (blocks, scheduler) in ["4-6", "0-2", "3"].iter().zip(schedulers) {
        succeed(&folder, &format!("{RENDER} --scheduler {scheduler} --blocks {blocks} --film {blocks}.film"));
    }
    let said = refused(&folder, "merge 4-6.film 0-2.film -o out.exr");
    assert!(said.contains("--blocks 3 "), "{said}");
    let said = refused(&folder, "merge 4-6.film 3.film 4-6.film -o out.exr");
    assert!(said.contains("blocks 4-5 as well"), "{said}");
    assert!(!folder.path("out.exr").exists());

    succeed(&folder, "merge 4-6.film 0-2.film --partial -o most.film");
    succeed(&folder, "merge 3.film most.film -o all.film");
    succeed(&folder, "image all.film -o all.exr");
    succeed(&folder, "merge 4-6.film 3.film 0-2.film -o merged.exr");
    for name in ["all.exr", "merged.exr", "all.film"] {
        assert_same(&folder, name, "whole.exr");
    }
    // Where nothing is left to the device, to the byte.
    let render = format!("{RENDER} --scheduler bounce --fetch storage");
    succeed(&folder, &format!("{render} -o whole.exr"));
    for blocks in ["0-2", "3-6"] {
        succeed(&folder, &format!("{render} --blocks {blocks} --film same-{blocks}.film"));
    }
    succeed(&folder, "merge same-3-6.film same-0-2.film -o same.exr");
    assert!(read(&folder, "same.exr") == read(&folder, "whole.exr"));
}

#[test]
fn a_film_is_gone_on_from_and_added_to() {
    let folder = inputs();
    succeed(&folder, &format!("{RENDER} -o whole.exr --film whole.film"));
    succeed(&folder, &format!("{} --film some.film", RENDER.replace("52", "21")));
    let said = refused(&folder, &format!("{RENDER} --film some.film"));
    assert!(said.contains("--resume"), "{said}");
    succeed(&folder, &format!("{RENDER} --film some.film --resume -o added.exr"));
    assert_same(&folder, "added.exr", "whole.exr");
    let said = refused(&folder, &format!("{} --film some.film --resume", RENDER.replace("52", "9")));
    assert!(said.contains("52 samples per pixel"), "{said}");
    // There is nothing to do, and the image is what it was.
    succeed(&folder, &format!("{RENDER} --film some.film --resume -o again.exr"));
    assert_same(&folder, "again.exr", "whole.exr");
    // What it has cost is told of all samples.
    let told = |name: &str| -> Value {
        let told = succeed(&folder, &format!("info {name} --json"));
        serde_json::from_str(&told).expect("it is JSON")
    };
    let rays = |name| told(name)["counters"]["bounce_rays"].clone();
    assert_eq!(rays("some.film"), rays("whole.film"));
    assert!(succeed(&folder, "info some.film").contains("all of 52 samples"));
}

#[test]
fn other_renders_are_refused_by_what_differs() {
    let folder = inputs();
    succeed(&folder, &format!("{RENDER} --film a.film --blocks 0-3"));
    for (flags, key) in [
        ("--width 40 --samples 52 --integrator mis --seed 2", "seed is 2 here and 0 there"),
        ("--width 40 --samples 52 --integrator explicit", "integrator"),
        ("--width 40 --samples 52 --integrator mis --block-samples 16", "block_samples"),
        ("--width 40 --samples 52 --integrator mis --max-bounces 3", "max_bounces"),
        ("--width 40 --samples 52 --integrator mis --numerics native", "numerics"),
        ("--width 41 --samples 52 --integrator mis", "width_pixels"),
    ] {
        let said = refused(&folder, &format!("{SCENE} {flags} --film a.film --resume"));
        assert!(said.contains(key), "{said}");
    }
    succeed(&folder, &format!("{RENDER} --seed 2 --film b.film --blocks 1-2"));
    let said = refused(&folder, "merge a.film b.film -o c.film");
    assert!(
        said.contains("a.film") && said.contains("b.film") && said.contains("seed is 0 here and 2 there"),
        "{said}"
    );
    folder.scene("lamp", CAMERA, "v -1 -1 0\nv 1 -1 0\nv 0 1 0.5\nf 1 2 3\n");
    let said = refused(&folder, &format!("{RENDER} --film a.film --resume"));
    assert!(said.contains("scene_hash"), "{said}");
    let said = refused(
        &folder,
        "render lamp.toml --width 16384 --height 16384 --samples 16000000 --block-samples 1 --film c.film",
    );
    assert!(said.contains("of memory") && said.contains("are available"), "{said}");
    let said = refused(&folder, &format!("{RENDER} --film c.film --blocks 3-7"));
    assert!(said.contains("7 blocks"), "{said}");
}

#[test]
fn damage_is_told_and_never_believed() {
    let folder = inputs();
    succeed(&folder, &format!("{RENDER} --film good.film"));
    let good = read(&folder, "good.film");
    let header = good.iter().enumerate().filter(|(_, byte)| **byte == b'\n').nth(2).expect("there are three lines").0;
    let flipped = |at: usize| {
        let mut bytes = good.clone();
        bytes[at] ^= 1;
        bytes
    };
    let cases: [(&str, Vec<u8>); 9] = [
        ("no film", Vec::new()),
        ("no film", b"\x89PNG\r\n\x1a\n".to_vec()),
        ("version 2", [b"raywave film 2\n", &good[15..]].concat()),
        ("damaged", good[..40].to_vec()),
        ("damaged", good[..header].to_vec()),
        ("damaged", flipped(header - 30)),
        ("damaged", flipped(header + 1000)),
        ("damaged", good[..good.len() - 1].to_vec()),
        ("damaged", [&good[..], b"x"].concat()),
    ];
    for (number, (what, bytes)) in cases.into_iter().enumerate() {
        fs::write(folder.path("bad.film"), bytes).expect("the file is written");
        for line in
            ["image bad.film -o out.exr", "merge bad.film -o out.exr", "info bad.film", "diff bad.film good.film"]
        {
            let said = refused(&folder, line);
            assert!(said.contains("bad.film") && said.contains(what), "case {number}, {line}: {said}");
        }
    }
    let said = refused(&folder, &format!("{RENDER} --film bad.film --resume"));
    assert!(said.contains("damaged"), "{said}");
}

#[test]
fn one_process_renders_into_a_film() {
    let folder = inputs();
    let mut first = start(&folder, &format!("{ENDLESS} --film busy.film --save-every 1ms"));
    await_file(&folder, "busy.film");
    let said = refused(&folder, &format!("{ENDLESS} --film busy.film --resume"));
    assert!(said.contains("another process"), "{said}");
    succeed(&folder, "image busy.film -o now.png");
    first.kill().expect("it runs");
    first.wait().expect("it has ended");
    // Nobody has the lock of a process that is gone.
    succeed(&folder, &format!("{ENDLESS} --film busy.film --resume --time 0.1s"));
    assert!(!folder.path(".busy.film.lock").exists());
}

fn start(folder: &Folder, line: &str) -> Child {
    let mut command = folder.command(&words(line));
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program starts")
}

fn await_file(folder: &Folder, name: &str) {
    let begun = Instant::now();
    while !folder.path(name).exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{name} does not come");
        sleep(Duration::from_millis(2));
    }
}

/// Kills at moments all over a render, some of them before its first save, and goes on until it is done. `RAYWAVE_KILLS`
/// says how often.
#[test]
fn a_render_that_is_killed_at_any_moment_goes_on_to_the_same_bits() {
    let kills = std::env::var("RAYWAVE_KILLS").ok().and_then(|kills| kills.parse().ok()).unwrap_or(50);
    let folder = inputs();
    let line = "render lamp.toml --width 64 --height 48 --block-samples 64 --film killed.film --save-every 1ms \
                --keep-every 1ms";
    // The samples grow with the kills, so that there is always something left to do.
    let (mut samples, mut random) = (500_u32, 12_345_u64);
    let begun = Instant::now();
    succeed(&folder, &format!("{line} --resume --samples {samples} --quiet"));
    let whole = begun.elapsed().as_secs_f64();
    for kill in 0..kills {
        samples += 60;
        let mut render = start(&folder, &format!("{line} --resume --samples {samples} --quiet"));
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let share = (random >> 33) as f64 / f64::from(1_u32 << 31);
        sleep(Duration::from_secs_f64(share * whole));
        // It may have ended by itself.
        let _ = render.kill();
        render.wait().expect("it has ended");
        if kill % 16 == 0 {
            succeed(&folder, "info killed.film");
        }
    }
    succeed(&folder, &format!("{line} --resume --samples {samples} -o killed.exr"));
    let whole = "render lamp.toml --width 64 --height 48 --block-samples 64 -o whole.exr";
    succeed(&folder, &format!("{whole} --samples {samples}"));
    assert_same(&folder, "killed.exr", "whole.exr");
    let names: Vec<String> = fs::read_dir(folder.path("."))
        .expect("the folder is there")
        .map(|entry| entry.expect("it is read").file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with('.'))
        .collect();
    assert!(names.is_empty(), "left behind: {names:?}");
}

#[test]
fn a_signal_leaves_a_film_to_go_on_from() {
    let folder = inputs();
    for (number, signal) in ["INT", "TERM", "HUP"].into_iter().enumerate() {
        let film = format!("{signal}.film");
        let line = format!("{ENDLESS} --film {film} --save-every 1h --quiet");
        let mut render = start(&folder, &line);
        sleep(Duration::from_millis(700 + 200 * number as u64));
        let kill = Command::new("kill").args([&format!("-{signal}"), &render.id().to_string()]).status();
        assert!(kill.expect("kill is there").success());
        render.wait().expect("it has ended");
        if !folder.path(&film).exists() {
            // It had not come to its first sample.
            continue;
        }
        let told = succeed(&folder, &format!("info {film} --json"));
        let told: Value = serde_json::from_str(&told).expect("it is JSON");
        assert!(told["film_samples"].as_u64() > Some(0), "{told}");
    }
}

/// On every device that there is: with one, nothing is shared, and the image is the same all the more.
#[test]
fn devices_share_a_render() {
    let folder = inputs();
    succeed(&folder, &format!("{RENDER} -o whole.exr"));
    // Of all drivers that are installed, where the test's own environment names one.
    let shared = |line: &str| {
        let output = folder.command(&words(line)).env_remove("RAYWAVE_DEVICE").output().expect("the program starts");
        assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    };
    shared(&format!("{RENDER} --devices all -o shared.exr --film shared.film"));
    assert_same(&folder, "shared.exr", "whole.exr");
    shared(&format!("{RENDER} --devices 0 -o one.exr"));
    assert_same(&folder, "one.exr", "whole.exr");
    let said = refused(&folder, &format!("{RENDER} --devices 0,0 -o twice.exr"));
    assert!(said.contains("twice"), "{said}");
}

#[test]
fn time_and_error_end_a_render() {
    let folder = inputs();
    let render = "render lamp.toml --width 64 --height 48 --integrator mis";
    let stats = |line: &str| -> Value {
        let told = succeed(&folder, &format!("{line} --stats - -q"));
        serde_json::from_str(&told).expect("it is JSON")
    };
    let told = stats(&format!("{render} --time 0.3s -o time.exr"));
    let seconds = told["wall_seconds"].as_f64().expect("a number");
    assert!(seconds > 0.25 && told["settings"]["samples_per_pixel"].as_u64() > Some(1), "{told}");
    let told = stats(&format!("{render} --target-error 0.01 -o error.exr --film error.film"));
    let error = told["relmse_by_halves"].as_f64().expect("a number");
    assert!(error <= 0.01 && told["settings"]["halves"] == Value::Bool(true), "{told}");
    // A few samples are not enough.
    let told = folder.run(&words(&format!("{render} --target-error 1e-9 --samples 8 -o few.exr")));
    assert!(text(&told.stderr).contains("asked for; more --samples"), "{}", text(&told.stderr));
    let said = refused(&folder, &format!("{render} --time 1s --blocks 0 --film x.film"));
    assert!(said.contains("--blocks"), "{said}");
}
