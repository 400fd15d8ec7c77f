//! Ray dumps as files: round trips, the bytes that other programs read, and every fault with its place.

use std::fs;
use std::path::PathBuf;

use proptest::prelude::*;
use raywave::constants::NO_TRIANGLE;
use raywave::rays::{Metadata, RayClass, RayDump, RayOrder, RayRecord, RayScene, RaysError, RecordLayout};
use raywave::rays::{write_distances, write_triangles};
use tempfile::TempDir;

const TRIANGLES: u32 = 12;
const RECORD_BYTES: usize = 32;
const NO_CHANGE: fn(&mut RayScene) = |_| ();

fn scene() -> RayScene {
    RayScene {
        scene: "box".into(),
        scene_hash: "0123abcd".into(),
        triangles: TRIANGLES,
        placed: Vec::new(),
        centre: [0.1, -1e300, 0.3],
        scale: 0.25,
    }
}

fn dump(class: RayClass, rays: Vec<RayRecord>) -> RayDump {
    let metadata = Metadata {
        raywave_version: "0.1.0".into(),
        scene: scene(),
        class,
        bounce: 3,
        rays: rays.len() as u64,
        order: RayOrder::Slot,
        width_pixels: 4,
        height_pixels: 5,
        pixels: 20,
        samples_per_pixel: 6,
        seed: 7,
        integrator: "explicit".into(),
        max_bounces: -1,
        roulette: 0.1 + 0.2,
        device: "abacus \"2\"\n".into(),
        driver: "wood".into(),
        record: RecordLayout::of_rays(&scene()),
    };
    RayDump { metadata, rays }
}

fn ray(target: u32) -> RayRecord {
    record([1.0, -2.0, 0.5], 5, [0.0, -0.0, 1e-40], target)
}

fn record(origin: [f32; 3], leaves: u32, direction: [f32; 3], target: u32) -> RayRecord {
    RayRecord { origin, leaves, direction, target, leaves_instance: 0, target_instance: 0 }
}

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("a.rays")
    }

    fn bytes_of(&self, dump: &RayDump) -> Vec<u8> {
        dump.write(&self.path()).expect("the dump is written");
        fs::read(self.path()).expect("it was just written")
    }

    fn read(&self, bytes: &[u8]) -> Result<RayDump, RaysError> {
        fs::write(self.path(), bytes).expect("a temporary file");
        RayDump::read(&self.path(), &scene())
    }

    /// What is said of bytes that are no dump, after the file's name.
    fn complaint(&self, bytes: &[u8], change: impl Fn(&mut RayScene)) -> String {
        fs::write(self.path(), bytes).expect("a temporary file");
        let mut scene = scene();
        change(&mut scene);
        let message = RayDump::read(&self.path(), &scene).expect_err("the file is malformed").to_string();
        let said = message.strip_prefix(&format!("{}: ", self.path().display()));
        said.unwrap_or_else(|| panic!("{message:?} names the file")).to_owned()
    }
}

/// Where the records begin.
fn records_start(bytes: &[u8]) -> usize {
    let mut ends = bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\n').map(|(at, _)| at + 1);
    ends.nth(1).expect("a dump has two lines")
}

/// A dump with a piece of its metadata replaced.
fn edited(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let (head, records) = bytes.split_at(records_start(bytes));
    let head = std::str::from_utf8(head).expect("metadata is UTF-8");
    assert!(head.contains(from), "{from} in {head}");
    [head.replacen(from, to, 1).as_bytes(), records].concat()
}

fn any_ray() -> impl Strategy<Value = RayRecord> {
    let finite = || prop::num::f32::ANY.prop_filter("finite", |x| x.is_finite());
    let triangle = || prop_oneof![Just(NO_TRIANGLE), 0..TRIANGLES];
    (prop::array::uniform3(finite()), triangle(), prop::array::uniform3(finite()), triangle())
        .prop_filter("a direction", |(_, _, direction, _)| *direction != [0.0; 3])
        .prop_map(|(origin, leaves, direction, target)| record(origin, leaves, direction, target))
}

proptest! {
    #[test]
    fn dumps_survive_a_round_trip(
        rays in prop::collection::vec(any_ray(), 1..50),
        centre in prop::array::uniform3(prop::num::f64::NORMAL),
        exponent in -60..60_i32,
        roulette in 0.0..1.0_f64,
    ) {
        let mut dump = dump(RayClass::Shadow, rays);
        dump.metadata.scene.centre = centre;
        dump.metadata.scene.scale = f64::from(exponent).exp2();
        dump.metadata.roulette = roulette;
        let folder = Folder::new();
        dump.write(&folder.path()).expect("the dump is written");
        let back = RayDump::read(&folder.path(), &dump.metadata.scene).expect("the dump is readable");
        prop_assert_eq!(&back.metadata, &dump.metadata);
        prop_assert_eq!(bytemuck::cast_slice::<_, u32>(&back.rays), bytemuck::cast_slice::<_, u32>(&dump.rays));
    }

    #[test]
    fn a_dump_that_is_cut_anywhere_is_told(share in 0.0..1.0_f64) {
        let folder = Folder::new();
        let bytes = folder.bytes_of(&dump(RayClass::Shadow, vec![ray(3); 4]));
        let at = (share * bytes.len() as f64) as usize;
        let complaint = folder.complaint(&bytes[..at], NO_CHANGE);
        let expected = if at < 15 { "byte 0: ".to_owned() } else { format!("byte {at}: the file ends ") };
        prop_assert!(complaint.starts_with(&expected), "{}", complaint);
    }

    #[test]
    fn damage_is_told_in_one_line(at in 0.0..1.0_f64, byte: u8) {
        let folder = Folder::new();
        let mut bytes = folder.bytes_of(&dump(RayClass::Camera, vec![ray(NO_TRIANGLE); 4]));
        let at = (at * bytes.len() as f64) as usize;
        bytes[at] = byte;
        if let Err(error) = folder.read(&bytes) {
            let message = error.to_string();
            prop_assert!(message.contains("byte ") && !message.contains('\n'), "{}", message);
        }
    }
}

#[test]
fn other_programs_find_what_the_page_promises() {
    let folder = Folder::new();
    let bytes = folder.bytes_of(&dump(RayClass::Shadow, vec![ray(3), ray(NO_TRIANGLE)]));
    assert!(bytes.starts_with(b"raywave rays 1\n{"));
    let start = records_start(&bytes);
    let metadata: serde_json::Value = serde_json::from_slice(&bytes[15..start]).expect("the second line is JSON");
    assert_eq!(metadata["class"], "shadow");
    assert_eq!(metadata["order"], "slot");
    assert_eq!(metadata["rays"], 2);
    assert_eq!(metadata["scene_hash"], "0123abcd");
    assert_eq!(metadata["centre"][0], 0.1);
    assert_eq!(metadata["scale"], 0.25);
    assert_eq!(metadata["record"]["itemsize"], RECORD_BYTES);
    let records = &bytes[start..];
    assert_eq!(records.len(), 2 * RECORD_BYTES);
    let offset = |field: usize| metadata["record"]["offsets"][field].as_u64().expect("offsets are counts") as usize;
    let word = |at: usize| <[u8; 4]>::try_from(&records[at..at + 4]).expect("four bytes");
    assert_eq!(f32::from_le_bytes(word(offset(0) + 4)), -2.0, "origin y");
    assert_eq!(u32::from_le_bytes(word(offset(1))), 5, "leaves");
    assert_eq!(f32::from_le_bytes(word(offset(2) + 8)), 1e-40, "direction z");
    assert_eq!(u32::from_le_bytes(word(offset(3))), 3, "target");
    assert_eq!(u32::from_le_bytes(word(RECORD_BYTES + offset(3))), NO_TRIANGLE, "target of the second");
}

#[test]
fn malformed_metadata_is_told_with_its_byte() {
    let folder = Folder::new();
    let good = folder.bytes_of(&dump(RayClass::Shadow, vec![ray(3); 4]));
    folder.read(&good).expect("the dump is good");
    let end = good.len();
    for (bytes, said) in [
        (Vec::new(), "byte 0: this is no ray dump".to_owned()),
        (b"v 0 0 0\nf 1 2 3\n".to_vec(), "byte 0: this is no ray dump".into()),
        (vec![0; 5000], "byte 0: this is no ray dump".into()),
        (edited(&good, "rays 1", "rays 22"), "byte 13: the dump has version 22".into()),
        ([good[..15].to_vec(), vec![b' '; 2 << 20]].concat(), "byte 1048591: the line of metadata does not end".into()),
        (edited(&good, "{", "["), "byte 15: the metadata cannot be read".into()),
        (
            edited(&good, "\"class\":\"shadow\"", "\"class\":\"sorrow\""),
            "the metadata cannot be read: unknown variant".into(),
        ),
        (edited(&good, "\"seed\"", "\"feed\""), "the metadata cannot be read: missing field `seed`".into()),
        (edited(&good, "\"scene_hash\"", "\"scene_hush\""), "missing field `scene_hash`".into()),
        (edited(&good, "\"rays\":4", "\"rays\":-4"), "the metadata cannot be read".into()),
        (edited(&good, "\"rays\":4", "\"rays\":0"), "byte 15: the dump says that it holds 0 rays".into()),
        (edited(&good, "\"rays\":4", "\"rays\":999999999999999999"), "it holds 999999999999999999 rays".into()),
        (edited(&good, "\"rays\":4", "\"rays\":5"), format!("byte {end}: the file ends after 4 of 5 rays")),
        (edited(&good, "\"rays\":4", "\"rays\":3"), format!("byte {}: the file goes on after the last of 3", end - 32)),
        (
            edited(&good, "\"itemsize\":32", "\"itemsize\":48"),
            "byte 15: the records are laid out in another way".into(),
        ),
        (edited(&good, "<f4", ">f4"), "byte 15: the records are laid out in another way".into()),
    ] {
        let complaint = folder.complaint(&bytes, NO_CHANGE);
        assert!(complaint.contains(&said) && !complaint.contains('\n'), "{complaint:?}, not {said:?}");
    }
}

#[test]
fn rays_of_another_scene_are_refused() {
    let folder = Folder::new();
    let good = folder.bytes_of(&dump(RayClass::Shadow, vec![ray(3); 4]));
    let hash = folder.complaint(&good, |scene| scene.scene_hash = "fedc".into());
    assert!(hash.starts_with("byte 15: the rays are of scene box with hash 0123abcd and this is box with hash fedc"));
    let others: [fn(&mut RayScene); 3] = [|s| s.triangles += 1, |s| s.scale = 0.5, |s| s.centre[2] = 0.0];
    for change in others {
        let space = folder.complaint(&good, change);
        assert!(space.starts_with("byte 15: the dump of raywave 0.1.0 lays its scene into another space"), "{space}");
    }
    // Names are for people.
    let mut renamed = scene();
    renamed.scene = "crate".into();
    RayDump::read(&folder.path(), &renamed).expect("the hash decides");
}

#[test]
fn rays_that_cannot_be_traced_are_told_with_their_byte() {
    let folder = Folder::new();
    let check = |class, change: fn(&mut RayRecord), byte: usize, said: &str| {
        let mut rays = vec![ray(NO_TRIANGLE); 4];
        change(&mut rays[2]);
        let bytes = folder.bytes_of(&dump(class, rays));
        let complaint = folder.complaint(&bytes, NO_CHANGE);
        let expected = format!("byte {}: ray 2: {said}", records_start(&bytes) + 2 * RECORD_BYTES + byte);
        assert_eq!(complaint, expected);
    };
    for class in [RayClass::Camera, RayClass::Bounce, RayClass::Shadow] {
        check(class, |r| r.origin[1] = f32::NAN, 4, "origin holds NaN, which is not finite");
        check(class, |r| r.origin[2] = f32::INFINITY, 8, "origin holds inf, which is not finite");
        check(class, |r| r.leaves = TRIANGLES, 12, "leaves is triangle 12 and the scene has 12");
        check(class, |r| r.direction[2] = f32::NEG_INFINITY, 24, "direction holds -inf, which is not finite");
        check(class, |r| r.direction = [0.0, -0.0, 0.0], 16, "direction is zero");
        check(class, |r| r.target = NO_TRIANGLE - 1, 28, "target is triangle 4294967294 and the scene has 12");
    }
    check(RayClass::Bounce, |r| r.target = 1, 28, "target is a triangle, which only shadow rays have");
}

/// Two meshes in their places: instances 1 to 3 have seven triangles each, 4 and 5 have two.
fn placed(mut dump: RayDump) -> RayDump {
    dump.metadata.scene.placed = vec![[7, 3], [2, 2]];
    dump.metadata.record = RecordLayout::of_rays(&dump.metadata.scene);
    dump
}

#[test]
fn rays_of_placed_meshes_have_instances() {
    let folder = Folder::new();
    let of_instances = |leaves, leaves_instance, target, target_instance| RayRecord {
        leaves,
        leaves_instance,
        target_instance,
        ..ray(target)
    };
    let rays = vec![of_instances(6, 3, 1, 5), of_instances(11, 0, NO_TRIANGLE, 0), ray(NO_TRIANGLE)];
    let whole = placed(dump(RayClass::Shadow, rays));
    let bytes = folder.bytes_of(&whole);
    assert!(bytes.starts_with(b"raywave rays 2\n{"));
    assert_eq!(bytes.len() - records_start(&bytes), 3 * 40);
    let read = |scene: &RayScene| RayDump::read(&folder.path(), scene);
    assert_eq!(read(&whole.metadata.scene).expect("the dump is good"), whole);
    // Without instances it is another scene.
    assert!(read(&scene()).expect_err("they are not the same").to_string().contains("another space"));
    let check = |ray: RayRecord, byte: usize, said: &str| {
        let bytes = folder.bytes_of(&placed(dump(RayClass::Shadow, vec![ray])));
        let complaint = folder.complaint(&bytes, |scene| scene.placed = vec![[7, 3], [2, 2]]);
        assert_eq!(complaint, format!("byte {}: ray 0: {said}", records_start(&bytes) + byte));
    };
    check(of_instances(7, 3, NO_TRIANGLE, 0), 12, "leaves is triangle 7 and its instance has 7");
    check(of_instances(2, 4, NO_TRIANGLE, 0), 12, "leaves is triangle 2 and its instance has 2");
    check(of_instances(0, 6, NO_TRIANGLE, 0), 32, "leaves is of instance 6 and the scene has 6");
    check(of_instances(0, 1, 0, u32::MAX), 36, "target is of instance 4294967295 and the scene has 6");
    // The version and the records say the same.
    let bytes = folder.bytes_of(&whole);
    let wrong = edited(&bytes, "rays 2", "rays 1");
    let complaint = folder.complaint(&wrong, |scene| scene.placed = vec![[7, 3], [2, 2]]);
    assert!(complaint.contains("laid out in another way"), "{complaint}");
}

#[test]
fn dumps_of_many_rays_are_read_whole() {
    // Records are read and written some tens of thousands at a time.
    let folder = Folder::new();
    for rays in [(1 << 15) - 1, 1 << 15, (1 << 15) + 1, 1 << 16] {
        let many: Vec<RayRecord> = (0..rays)
            .map(|i| RayRecord { origin: [i as f32, 0.5, -1.0], leaves: i % TRIANGLES, ..ray(NO_TRIANGLE) })
            .collect();
        let dump = dump(RayClass::Bounce, many);
        let bytes = folder.bytes_of(&dump);
        let start = records_start(&bytes);
        assert_eq!(bytes.len() - start, rays as usize * RECORD_BYTES);
        assert_eq!(folder.read(&bytes).expect("it was just written"), dump);
        for end in [bytes.len() - 1, bytes.len() - RECORD_BYTES] {
            let told = format!("byte {end}: the file ends after {} of {rays} rays", rays - 1);
            let said = folder.complaint(&bytes[..end], NO_CHANGE);
            assert!(said.starts_with(&told), "{said}");
        }
        let told = format!("byte {}: the file goes on after the last of {rays} rays", bytes.len());
        let said = folder.complaint(&[&bytes[..], &[0]].concat(), NO_CHANGE);
        assert!(said.starts_with(&told), "{said}");
        // Of several faults the first is told.
        let mut damaged = bytes.clone();
        for number in [rays as usize - 1, rays as usize / 2 + 3, rays as usize / 2 + 4] {
            damaged[start + number * RECORD_BYTES..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        }
        let first = rays as usize / 2 + 3;
        let told = format!("byte {}: ray {first}: origin holds NaN", start + first * RECORD_BYTES);
        let said = folder.complaint(&damaged, NO_CHANGE);
        assert!(said.starts_with(&told), "{said}");
    }
}

#[test]
fn what_cannot_be_read_or_written_is_told_and_leaves_nothing() {
    let folder = Folder::new();
    let dump = dump(RayClass::Camera, vec![ray(NO_TRIANGLE)]);
    let missing = folder.0.path().join("nowhere/a.rays");
    let message = dump.write(&missing).expect_err("the folder is missing").to_string();
    assert!(message.contains("cannot be written: ") && message.contains("is missing"), "{message}");
    let message = dump.write(folder.0.path()).expect_err("it is a folder").to_string();
    assert!(message.contains("it is a folder"), "{message}");
    for path in [&missing, folder.0.path()] {
        let message = RayDump::read(path, &scene()).expect_err("no file").to_string();
        assert!(message.contains("cannot read the rays ("), "{message}");
    }
    assert_eq!(fs::read_dir(folder.0.path()).expect("the folder is there").count(), 0);
}

/// Shape and numbers of a `.npy` file of version 1.0, read as `numpy.lib.format` says.
fn npy(bytes: &[u8]) -> (String, Vec<f32>) {
    assert!(bytes.starts_with(b"\x93NUMPY\x01\x00"));
    let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let head = std::str::from_utf8(&bytes[10..end]).expect("the head is ASCII");
    assert!(end % 64 == 0 && head.ends_with('\n'), "{end} {head:?}");
    let shape = head.trim_end().strip_prefix("{'descr': '<f4', 'fortran_order': False, 'shape': ");
    let shape = shape.and_then(|rest| rest.strip_suffix(", }")).unwrap_or_else(|| panic!("{head:?}"));
    let numbers = bytes[end..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().expect("whole numbers"))).collect();
    (shape.to_owned(), numbers)
}

#[test]
fn arrays_beside_a_dump_are_those_that_numpy_reads() {
    let folder = Folder::new();
    let path = folder.0.path().join("a.npy");
    let read = || npy(&fs::read(&path).expect("the file is written"));
    for count in [0, 1, 12_345] {
        let triangles: Vec<_> =
            (0..count).map(|i| [[i as f32, -0.5, 2.0], [0.25; 3], [1e-40, f32::MAX, 7.0]]).collect();
        write_triangles(&path, &triangles).expect("the triangles are written");
        assert_eq!(read(), (format!("({count}, 3, 3)"), triangles.concat().concat()));
        let distances: Vec<_> = (0..count).map(|i| if i % 2 == 0 { i as f32 } else { f32::INFINITY }).collect();
        write_distances(&path, &distances).expect("the distances are written");
        assert_eq!(read(), (format!("({count},)"), distances));
    }
    let missing = folder.0.path().join("nowhere/a.npy");
    let message = write_distances(&missing, &[1.0]).expect_err("the folder is missing").to_string();
    assert!(message.contains("cannot be written: ") && message.contains("is missing"), "{message}");
}
