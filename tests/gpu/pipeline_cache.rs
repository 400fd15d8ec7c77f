//! Compiled kernels on disk: they change no image, and nothing that befalls them is an error.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use crate::common::{assert_silent, device_with_cache, own_scene};
use glam::DVec3;
use raywave::render::{PreparedScene, Session};
use raywave::settings::Settings;

/// The sums of a small render on a device of its own, whose kernels are kept in that folder.
fn sums(folder: Option<&Path>) -> Vec<DVec3> {
    let device = device_with_cache(folder);
    let scene = own_scene("cornell-box");
    let settings = Settings { width: 8, height: 8, samples: 1, ..scene.settings };
    let prepared = PreparedScene::new(&scene).expect("the scene fits");
    let mut session = Session::new(&device, &prepared, &settings).expect("the session starts");
    let film = session.render(|_| ControlFlow::Continue(())).expect("the render ends").film;
    drop(session);
    assert_silent(&device);
    film.sum
}

#[test]
fn a_cache_changes_no_image() {
    let parent = tempfile::tempdir().expect("a temporary folder");
    // It is made when there is something to keep.
    let folder = parent.path().join("made/anew");
    let reference = sums(None);
    let files = || fs::read_dir(&folder).into_iter().flatten().map(|entry| entry.expect("it is readable").path());
    for what in ["an empty cache", "a cache that was filled", "a damaged cache"] {
        assert!(reference == sums(Some(&folder)), "{what} changes the image");
        if what == "a cache that was filled" {
            for file in files() {
                let bytes = fs::read(&file).expect("a cache is readable");
                fs::write(&file, &bytes[..bytes.len() / 2]).expect("a cache is writable");
            }
        }
    }
}

#[test]
fn a_cache_that_cannot_be_written_is_no_error() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("file");
    fs::write(&file, "no folder").expect("a temporary file");
    assert!(sums(None) == sums(Some(&file.join("below a file"))));
    assert_eq!(fs::read(&file).expect("it is still there"), b"no folder");
}
