//! Scene files read from disk: what the format means, against closed forms, and what is said about
//! files that break it. Random and mutated files must give an error or a scene, never a panic.

use std::{f64::consts::FRAC_1_SQRT_2, fs, io::Cursor, path::PathBuf};

use crate::project::project_file;
use glam::{Affine2, DMat3, DVec3, Vec2, Vec3, dvec2, dvec3, vec2, vec3};
use proptest::prelude::*;
use raywave::scene::{Environment, Material, NONE, Parameter, Scene, SceneError, Surface, Wrap};
use raywave::settings::Integrator;
use raywave_studies::gallery::generate_gallery;
use tempfile::TempDir;

/// Lines 1 to 4 of a scene file.
const CAMERA: &str = "[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nvfov = 40\n";
const MESH: &str = "[[mesh]]\nfile = \"m.obj\"\n";
const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
const LIT_TRIANGLE: &str = "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
const TEXTURED: &str = "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n\
                        f 1/1 2/2 3/3\n";

/// A folder of scene files that lives as long as the value.
struct Folder(TempDir);

impl Folder {
    fn new<T: AsRef<[u8]>>(files: &[(&str, T)]) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        for (name, contents) in files {
            folder.write(name, contents);
        }
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, contents: impl AsRef<[u8]>) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, contents).unwrap();
    }

    fn load(&self, name: &str) -> Result<Scene, SceneError> {
        Scene::load(&self.path(name))
    }
}

/// A scene of one mesh, `m.obj`, and one MTL file, `m.mtl`.
fn scene_of(obj: &str, mtl: &str) -> Scene {
    scene_with("", obj, mtl)
}

/// The same with more TOML under the mesh.
fn scene_with(toml: &str, obj: &str, mtl: &str) -> Scene {
    let toml = format!("{CAMERA}{MESH}{toml}");
    let files = [("s.toml", toml.as_str()), ("m.obj", obj), ("m.mtl", mtl)];
    Folder::new(&files).load("s.toml").unwrap()
}

fn material_of(mtl: &str) -> Material {
    let scene = scene_of(LIT_TRIANGLE, mtl);
    assert_eq!(scene.materials.len(), 1);
    scene.materials[0].clone()
}

fn corners(scene: &Scene, triangle: usize) -> [DVec3; 3] {
    let positions = scene.mesh.triangles[triangle].positions;
    positions.map(|index| scene.mesh.positions[index as usize])
}

fn warns(scene: &Scene, phrase: &str) -> bool {
    for warning in &scene.warnings {
        assert!(!warning.contains('\n'), "more than one line: {warning}");
    }
    scene.warnings.iter().any(|warning| warning.contains(phrase))
}

fn png(width: u32, height: u32, rgb: &[[u8; 3]]) -> Vec<u8> {
    let image = image::RgbImage::from_raw(width, height, rgb.concat()).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn hdr(width: usize, height: usize, rgb: &[[f32; 3]]) -> Vec<u8> {
    let pixels: Vec<_> = rgb.iter().map(|&rgb| image::Rgb(rgb)).collect();
    let mut bytes = Vec::new();
    let encoder = image::codecs::hdr::HdrEncoder::new(&mut bytes);
    encoder.encode(&pixels, width, height).unwrap();
    bytes
}

fn exr<T: exr::prelude::IntoSample>(size: (usize, usize), pixel: impl Sync + Fn(usize, usize) -> [T; 3]) -> Vec<u8> {
    use exr::prelude::*;

    let pixel = |at: Vec2<usize>| {
        let [r, g, b] = pixel(at.x(), at.y());
        (r, g, b)
    };
    let image = Image::from_channels(size, SpecificChannels::rgb(pixel));
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

// The scene file

#[test]
fn defaults_are_those_of_the_format() {
    let scene = scene_of(TRIANGLE, "");
    assert_eq!(scene.name, "s");
    assert_eq!((scene.settings.width, scene.settings.height), (512, 512));
    assert_eq!(scene.settings.integrator, Integrator::Explicit);
    assert_eq!(scene.settings.samples, 64);
    assert_eq!(scene.settings.max_bounces, Some(8));
    assert_eq!(scene.settings.roulette, 0.0);
    assert_eq!(scene.camera.up, DVec3::Y);
    assert_eq!(scene.camera.aperture, 0.0);
    assert_eq!(scene.camera.focus, 5.0);
    assert!(matches!(scene.environment, Environment::Black));
    let material = &scene.materials[0];
    assert_eq!((material.diffuse, material.specular), (Vec3::splat(0.8), Vec3::ZERO));
    assert_eq!((material.exponent, material.ior), (1.0, 1.0));
    assert_eq!((material.transmission, material.emission), (Vec3::ONE, Vec3::ZERO));
    assert_eq!(material.surface, Surface::Glossy);
    assert!(warns(&scene, "nothing emits light"));
}

#[test]
fn every_key_is_read() {
    let toml = "
        [camera]
        eye = [1, 2, 3]
        target = [0, 0.5, 0]
        up = [0, 0, 1]
        vfov = 33.5
        aperture = 0.1
        focus = 2.5
        [film]
        width = 640
        height = 360
        [render]
        integrator = 'implicit'
        samples = 7
        max_bounces = -1
        roulette = 0.25
        [[mesh]]
        file = 'm.obj'
        [environment]
        radiance = [1, 2, 3]
    ";
    let scene = Folder::new(&[("s.toml", toml), ("m.obj", TRIANGLE)]).load("s.toml").unwrap();
    let camera = scene.camera;
    assert_eq!((camera.eye, camera.target), (dvec3(1., 2., 3.), dvec3(0., 0.5, 0.)));
    assert_eq!((camera.up, camera.vfov), (DVec3::Z, 33.5));
    assert_eq!((camera.aperture, camera.focus), (0.1, 2.5));
    assert_eq!((scene.settings.width, scene.settings.height), (640, 360));
    assert_eq!(scene.settings.integrator, Integrator::Implicit);
    assert_eq!(scene.settings.samples, 7);
    assert_eq!(scene.settings.max_bounces, None);
    assert_eq!(scene.settings.roulette, 0.25);
    assert!(matches!(scene.environment, Environment::Constant(rgb) if rgb == vec3(1., 2., 3.)));
    assert!(scene.warnings.is_empty());
}

#[test]
fn transforms_scale_then_rotate_about_x_y_z_then_translate() {
    let toml = "scale = [2, 3, 4]\nrotate = [90, 90, 0]\ntranslate = [10, 20, 30]\n";
    let obj = "v 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n";
    let scene = scene_with(toml, obj, "");
    // A quarter turn about x takes y to z and z to -y, one about y then takes z to x, x to -z.
    let expected = [dvec3(10., 20., 28.), dvec3(13., 20., 30.), dvec3(10., 16., 30.)];
    for (corner, expected) in corners(&scene, 0).into_iter().zip(expected) {
        assert!(corner.distance(expected) < 1e-12, "{corner} is not {expected}");
    }
    let scene = scene_with("rotate = [0, 0, 45]\n", obj, "");
    let expected = dvec3(FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0);
    assert!(corners(&scene, 0)[0].distance(expected) < 1e-12);
}

#[test]
fn normals_stay_perpendicular_under_uneven_scale() {
    let toml = "scale = [1, 5, 0.25]\nrotate = [20, 30, 40]\ntranslate = [1, 2, 3]\n";
    let obj = "v 1 0 0\nv 0 1 0\nv 0 0 1\nvn 3 3 3\nf 1//1 2//1 3//1\n";
    let scene = scene_with(toml, obj, "");
    let [a, b, c] = corners(&scene, 0);
    let geometric = (b - a).cross(c - a).normalize();
    assert_eq!(scene.mesh.triangles[0].normals, [0; 3]);
    let shading = scene.mesh.normals[0].as_dvec3();
    assert!((shading.length() - 1.0).abs() < 1e-6);
    assert!((shading.dot(geometric) - 1.0).abs() < 1e-6);
}

#[test]
fn a_mirroring_scale_turns_the_front_around() {
    let front = |toml: &str| {
        let [a, b, c] = corners(&scene_with(toml, TRIANGLE, ""), 0);
        (b - a).cross(c - a).z
    };
    assert_eq!(front(""), 1.0);
    assert_eq!(front("scale = [-1, 1, 1]\n"), -1.0);
    assert_eq!(front("scale = [-1, -1, 1]\n"), 1.0);
}

#[test]
fn a_mesh_placed_twice_shares_its_materials() {
    let again = "[[mesh]]\nfile = \"m.obj\"\ntranslate = [5, 0, 0]\n";
    let scene = scene_with(again, LIT_TRIANGLE, "newmtl a\nKe 1 1 1\n");
    assert_eq!(scene.mesh.triangles.len(), 2);
    assert_eq!(scene.materials.len(), 1);
    assert_eq!(scene.bounds(), (DVec3::ZERO, dvec3(6.0, 1.0, 0.0)));
    assert_eq!(scene.light_triangles().collect::<Vec<_>>(), [0, 1]);
}

#[test]
fn one_name_in_two_files_is_two_materials_and_one_override() {
    let toml = format!(
        "{CAMERA}[[mesh]]\nfile = \"a/m.obj\"\n[[mesh]]\nfile = \"b/m.obj\"\n\
         [material.a]\nNs = 9\nKd = 0.5\n[material.typo]\nNs = 1\n"
    );
    let scene = Folder::new(&[
        ("s.toml", toml.as_str()),
        ("a/m.obj", LIT_TRIANGLE),
        ("a/m.mtl", "newmtl a\nKs 0.1 0.1 0.1\n"),
        ("b/m.obj", LIT_TRIANGLE),
        ("b/m.mtl", "newmtl a\nKs 0.2 0.2 0.2\n"),
    ])
    .load("s.toml")
    .unwrap();
    let [a, b] = &scene.materials[..] else {
        panic!("two materials");
    };
    assert_eq!((a.specular, b.specular), (Vec3::splat(0.1), Vec3::splat(0.2)));
    assert_eq!((a.exponent, b.exponent), (9.0, 9.0));
    assert_eq!((a.diffuse, b.diffuse), (Vec3::splat(0.5), Vec3::splat(0.5)));
    assert!(warns(&scene, "s.toml:12: no mesh uses material `typo`"));
}

#[test]
fn overrides_reach_every_key_and_need_no_mtl_file() {
    let toml = "[material.a]\nKd = [0.1, 0.2, 0.3]\nKs = 0.4\nNs = 5\nNi = 1.6\nTf = 0.7\n\
                illum = 2\nKe = 0\n[material.b]\nillum = 6\nNi = 1.4\n";
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 3 2 1\n";
    let scene = scene_with(toml, obj, "");
    let a = &scene.materials[0];
    assert_eq!((a.diffuse, a.specular), (vec3(0.1, 0.2, 0.3), Vec3::splat(0.4)));
    assert_eq!((a.exponent, a.ior, a.transmission), (5.0, 1.6, Vec3::splat(0.7)));
    let b = &scene.materials[1];
    assert_eq!((b.surface, b.ior), (Surface::Refractive, 1.4));
    assert!(!warns(&scene, "no material"));
}

#[test]
fn an_override_can_take_or_give_an_image() {
    let image = png(1, 1, &[[255; 3]]);
    let load = |key: &str, mtl: &str| {
        let toml = format!("{CAMERA}{MESH}[material.a]\nmap_Kd = \"{key}\"\n");
        let files: [(&str, &[u8]); 4] =
            [("s.toml", toml.as_bytes()), ("m.obj", TEXTURED.as_bytes()), ("m.mtl", mtl.as_bytes()), ("t.png", &image)];
        Folder::new(&files).load("s.toml").unwrap()
    };
    assert_eq!(load("", "newmtl a\nmap_Kd t.png\n").materials[0].texture(Parameter::Diffuse), None);
    assert_eq!(load("t.png", "newmtl a\n").materials[0].texture(Parameter::Diffuse), Some(0));
}

#[test]
fn the_hash_follows_names_and_contents_but_not_the_folder() {
    let hash = |mesh: &str, file: &str| {
        let toml = format!("{CAMERA}[[mesh]]\nfile = \"{file}\"\n");
        let files = [("s.toml", toml.as_str()), (file, mesh), ("m.mtl", "newmtl a\n")];
        Folder::new(&files).load("s.toml").unwrap().hash
    };
    let reference = hash(LIT_TRIANGLE, "m.obj");
    assert_eq!(reference.len(), 64);
    assert_eq!(reference, hash(LIT_TRIANGLE, "m.obj"));
    assert_ne!(reference, hash(LIT_TRIANGLE, "n.obj"));
    assert_ne!(reference, hash(&format!("{LIT_TRIANGLE} "), "m.obj"));
}

#[test]
fn the_embedded_cornell_box_is_the_one_on_disk() {
    let embedded = Scene::cornell_box();
    let path = project_file("scenes/cornell-box.toml");
    let on_disk = Scene::load(&path).unwrap();
    assert_eq!(embedded.hash, on_disk.hash);
    assert_eq!(embedded.mesh.triangles, on_disk.mesh.triangles);
    assert_eq!(embedded.light_triangles().count(), 2);
    assert!(embedded.warnings.is_empty());
}

#[test]
fn a_bare_mesh_is_seen_whole_and_lit() {
    let obj = "v -3 10 2\nv 4 10 2\nv 4 12 -9\nv -3 11 5\nf 1 2 3\nf 1 3 4\n";
    let scene = Folder::new(&[("m.OBJ", obj)]).load("m.OBJ").unwrap();
    assert_eq!(scene.name, "m");
    assert!(warns(&scene, "white environment"));
    assert!(matches!(scene.environment, Environment::Constant(rgb) if rgb == Vec3::ONE));
    let camera = scene.camera;
    let forward = (camera.target - camera.eye).normalize();
    assert!(forward.z < -0.9 && forward.y < 0.0);
    let right = forward.cross(camera.up).normalize();
    let up = right.cross(forward);
    let half = (0.5 * camera.vfov).to_radians().tan();
    for triangle in 0..2 {
        for corner in corners(&scene, triangle) {
            let offset = corner - camera.eye;
            let depth = offset.dot(forward);
            assert!(depth > 0.0);
            assert!((offset.dot(right) / depth).abs() < half);
            assert!((offset.dot(up) / depth).abs() < half);
        }
    }

    let files = [("m.obj", LIT_TRIANGLE), ("m.mtl", "newmtl a\nKe 1 1 1\n")];
    let scene = Folder::new(&files).load("m.obj").unwrap();
    assert!(matches!(scene.environment, Environment::Black));
    assert!(scene.warnings.is_empty());
}

// OBJ

#[test]
fn polygons_become_fans_and_indices_may_be_negative() {
    let obj = "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 3 0\nv -1 1 0\nf -5 -4 -3 -2 -1\nv 9 9 9\n";
    let scene = scene_of(obj, "");
    let [a, b, c, d, e] =
        [[0, 0], [2, 0], [3, 1], [1, 3], [-1, 1]].map(|[x, y]| dvec3(f64::from(x), f64::from(y), 0.0));
    assert_eq!(scene.mesh.triangles.len(), 3);
    assert_eq!(corners(&scene, 0), [a, b, c]);
    assert_eq!(corners(&scene, 1), [a, c, d]);
    assert_eq!(corners(&scene, 2), [a, d, e]);
}

#[test]
fn odd_but_valid_text_is_read() {
    let obj = "\u{feff}# comment\r\n\tv 0 0 0 # first\r\nv 1 0 0 0.5 0.5 0.5\r\ng a group\r\n\
               o object\r\ns off\r\nl 1 2 3\r\np 1\r\n  usemtl\ta  b # named with blanks\r\n\
               f 1 2 \\\r\n  3\r\nv 0 1 0 1\r\ncurv nonsense\r\nf\t1/ 2// 3\r\n";
    let scene = scene_of(obj, "");
    assert_eq!(scene.mesh.triangles.len(), 2);
    let expected = [DVec3::ZERO, DVec3::X, DVec3::Y];
    assert_eq!(corners(&scene, 0), expected);
    assert_eq!(corners(&scene, 1), expected);
    assert_eq!(scene.materials[0].name, "a b");
}

#[test]
fn corners_keep_their_own_normals_and_coordinates() {
    let obj = "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\n\
               vt 1 1\nvt 0 0.5\nvn 0 0 1\nvn 0 3 4\nf 1/1/1 2/2/1 3/3/2 4/4/2\n";
    let files: [(&str, &[u8]); 4] = [
        ("s.toml", format!("{CAMERA}{MESH}").leak().as_bytes()),
        ("m.obj", obj.as_bytes()),
        ("m.mtl", b"newmtl a\nmap_Kd t.png\n"),
        ("t.png", &png(1, 1, &[[255; 3]])),
    ];
    let scene = Folder::new(&files).load("s.toml").unwrap();
    let normal = |index: u32| scene.mesh.normals[index as usize];
    let uv = |index: u32| scene.mesh.uvs[index as usize];
    let tilted = vec3(0.0, 0.6, 0.8);
    let [first, second] = &scene.mesh.triangles[..] else {
        panic!("two triangles");
    };
    assert_eq!(first.normals.map(normal), [Vec3::Z, Vec3::Z, tilted]);
    assert_eq!(second.normals.map(normal), [Vec3::Z, tilted, tilted]);
    assert_eq!(first.uvs.map(uv), [Vec2::ZERO, Vec2::X, Vec2::ONE]);
    assert_eq!(second.uvs.map(uv), [Vec2::ZERO, Vec2::ONE, vec2(0.0, 0.5)]);
}

#[test]
fn a_triangle_without_three_good_normals_is_flat() {
    let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0 0 0\nvn nan 0 1\nvn inf 0 0\n";
    for face in ["f 1//1 2//1 3//2", "f 1//1 2//3 3//1", "f 1//4 2//1 3//1", "f 1//1 2 3//1"] {
        let scene = scene_of(&format!("{head}{face}\nf 1//1 2//1 3//1\n"), "");
        assert_eq!(scene.mesh.triangles[0].normals, [NONE; 3], "{face}");
        assert_ne!(scene.mesh.triangles[1].normals, [NONE; 3], "{face}");
    }
    let tiny = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1e-300\nf 1//1 2//1 3//1\n";
    assert_eq!(scene_of(tiny, "").mesh.normals, [Vec3::Z]);
}

#[test]
fn triangles_without_area_are_dropped_and_counted() {
    let obj = "v 0 0 0\nv 1 1 1\nv 3 3 3\nv 0 1 0\nf 1 2 3\nf 1 1 2\nf 1 2 4\n";
    let scene = scene_of(obj, "");
    assert_eq!(scene.mesh.triangles.len(), 1);
    assert!(warns(&scene, "2 triangles without area were dropped"));
}

#[test]
fn libraries_stand_on_one_line_or_several() {
    let faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\nusemtl c\nf 1 2 3\n";
    let obj = format!("mtllib one.mtl sub\\two.mtl\nmtllib with blank.mtl\n{faces}");
    let toml = format!("{CAMERA}{MESH}");
    let scene = Folder::new(&[
        ("s.toml", toml.as_str()),
        ("m.obj", &obj),
        ("one.mtl", "newmtl a\nKd 0.1 0.1 0.1\n"),
        ("sub/two.mtl", "newmtl b\nKd 0.2 0.2 0.2\n"),
        ("with blank.mtl", "newmtl c\nKd 0.3 0.3 0.3\n"),
    ])
    .load("s.toml")
    .unwrap();
    let kd: Vec<f32> = scene.materials.iter().map(|material| material.diffuse.x).collect();
    assert_eq!(kd, [0.1, 0.2, 0.3]);
}

#[test]
fn missing_libraries_and_materials_are_warnings() {
    let scene = scene_of("mtllib nowhere.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl x\nf 1 2 3\n", "");
    assert_eq!(scene.materials[0].diffuse, Vec3::splat(0.8));
    assert!(warns(&scene, "m.obj:1: cannot read"));
    assert!(!warns(&scene, "`x`"), "one warning is enough");

    let scene = scene_of("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl x\nf 1 2 3\n", "newmtl y\n");
    assert_eq!(scene.materials[0].diffuse, Vec3::splat(0.8));
    assert!(warns(&scene, "m.obj:5: no material `x`"));
}

#[test]
fn unused_materials_and_their_images_are_left_alone() {
    let mtl = "newmtl a\nKd 0.5 0.5 0.5\nmap_Kd nowhere.png\nillum 3\nKs 1 1 1\nnewmtl b\n\
               map_Kd nowhere.png\n";
    let scene = scene_of(TEXTURED, mtl);
    assert_eq!(scene.materials.len(), 1);
    assert_eq!(scene.materials[0].texture(Parameter::Diffuse), None);
    assert!(scene.textures.is_empty() && scene.mesh.uvs.is_empty());
    let emitter = scene_of(TEXTURED, "newmtl a\nKe 1 0 0\nmap_Kd nowhere.png\n");
    assert!(emitter.materials[0].is_emitter() && emitter.textures.is_empty());
}

// MTL

#[test]
fn illum_chooses_the_surface() {
    for (illum, surface) in [
        (0, Surface::Glossy),
        (1, Surface::Glossy),
        (2, Surface::Glossy),
        (3, Surface::Mirror),
        (4, Surface::Dielectric),
        (5, Surface::Mirror),
        (6, Surface::Refractive),
        (7, Surface::Dielectric),
        (9, Surface::Dielectric),
    ] {
        let material = material_of(&format!("newmtl a\nillum {illum}\nNi 1.5\nKs 0.5 0.5 0.5\n"));
        assert_eq!(material.surface, surface, "illum {illum}");
    }
    for illum in [8, 10, -1] {
        let scene = scene_of(LIT_TRIANGLE, &format!("newmtl a\nillum {illum}\n"));
        assert_eq!(scene.materials[0].surface, Surface::Glossy);
        assert!(warns(&scene, &format!("m.mtl:2: illum {illum}")));
    }
}

#[test]
fn one_number_is_grey_and_names_may_repeat() {
    let mtl = "newmtl a\nKd 0.25\nKe 2\nnewmtl b\nKd 1 1 1\nnewmtl a\nTf 0.5 # tint\nKe 0\n";
    let material = material_of(mtl);
    assert_eq!((material.diffuse, material.transmission), (Vec3::splat(0.25), Vec3::splat(0.5)));
    assert!(!material.is_emitter());
}

#[test]
fn kd_and_ks_are_scaled_by_their_largest_sum() {
    let scene = scene_of(LIT_TRIANGLE, "newmtl a\nKd 0.8 0.5 0\nKs 0.8 0 0.4\n");
    let material = &scene.materials[0];
    assert!(material.diffuse.distance(vec3(0.5, 0.3125, 0.0)) < 1e-6);
    assert!(material.specular.distance(vec3(0.5, 0.0, 0.25)) < 1e-6);
    assert!(warns(&scene, "m.mtl:1: Kd + Ks of `a` reaches 1.6"));

    let scene = scene_of(LIT_TRIANGLE, "newmtl a\nKd 0.9 0.7 0.6\nKs 0.1 0.3 0.4\n");
    assert!(!warns(&scene, "reaches"));
    let mirror = material_of("newmtl a\nillum 3\nKd 1 1 1\nKs 0.9 0.8 0.7\n");
    assert_eq!((mirror.diffuse, mirror.specular), (Vec3::ZERO, vec3(0.9, 0.8, 0.7)));
}

#[test]
fn ignored_keys_of_used_materials_are_named() {
    let scene = scene_of(LIT_TRIANGLE, "newmtl a\nKa 1 1 1\nmap_Bump b.png\nnewmtl c\nbump x.png\n");
    assert!(warns(&scene, "m.mtl:3: `map_Bump` is ignored"));
    assert!(!warns(&scene, "`bump`"));
}

// Images

fn textured(mtl: &str, image_name: &str, image: &[u8]) -> Scene {
    let toml = format!("{CAMERA}{MESH}");
    let files: [(&str, &[u8]); 4] =
        [("s.toml", toml.as_bytes()), ("m.obj", TEXTURED.as_bytes()), ("m.mtl", mtl.as_bytes()), (image_name, image)];
    Folder::new(&files).load("s.toml").unwrap()
}

#[test]
fn textures_are_linear_with_row_0_on_top() {
    let image = png(2, 2, &[[255, 0, 0], [0, 255, 0], [0, 0, 255], [188, 10, 128]]);
    let scene = textured("newmtl a\nmap_Kd t.png\n", "t.png", &image);
    assert_eq!(scene.materials[0].texture(Parameter::Diffuse), Some(0));
    let texture = &scene.textures[0];
    assert_eq!((texture.width, texture.height), (2, 2));
    let rgb = |index: usize| {
        let [r, g, b, _] = texture.texels[index].map(f32::from);
        vec3(r, g, b)
    };
    assert_eq!([rgb(0), rgb(1), rgb(2)], [Vec3::X, Vec3::Y, Vec3::Z]);
    let linear = vec3(0.502886, 0.003035, 0.215861);
    assert!(rgb(3).distance(linear) < 3e-4, "{}", rgb(3));
    assert_eq!(scene.mesh.uvs, [Vec2::ZERO, Vec2::X, Vec2::Y]);
}

#[test]
fn image_names_come_with_blanks_slashes_and_options() {
    let image = png(1, 1, &[[255; 3]]);
    for (written, name) in [
        ("my tiles.png", "my tiles.png"),
        ("maps\\fine\\t.png", "maps/fine/t.png"),
        ("-s 2 2 1 -clamp on t.png", "t.png"),
        ("-clamp off -blendu off t.png", "t.png"),
        ("-s 1.000000 1.000000 1.000000 wood tile 01.png", "wood tile 01.png"),
        ("-o 0.5 -s 2 2 oak 2.png", "oak 2.png"),
    ] {
        let scene = textured(&format!("newmtl a\nmap_Kd {written}\n"), name, &image);
        assert_eq!(scene.textures.len(), 1);
        let wrap = if written.contains("-clamp on") { Wrap::Clamp } else { Wrap::Repeat };
        assert_eq!(scene.textures[0].lookup.wrap, wrap);
        assert_eq!(warns(&scene, "the option -blendu of map_Kd is ignored"), written.contains("-blendu"));
    }
}

#[test]
fn a_bright_image_shares_the_energy_rule_with_ks() {
    let image = png(2, 1, &[[255; 3], [0; 3]]);
    let scene = textured("newmtl a\nKd 1 1 1\nKs 0.25\nmap_Kd t.png\n", "t.png", &image);
    assert!((scene.materials[0].specular.x - 0.2).abs() < 1e-6);
    assert!((f32::from(scene.textures[0].texels[0][0]) - 0.8).abs() < 1e-3);
    assert!(warns(&scene, "reaches 1.25"));

    let scene = textured("newmtl a\nmap_Kd t.hdr\n", "t.hdr", &hdr(1, 1, &[[4.0, 0.5, 0.25]]));
    assert_eq!(scene.textures[0].texels[0].map(f32::from), [1.0, 0.5, 0.25, 1.0]);
    assert!(warns(&scene, "brighter than 1"));
}

#[test]
fn faces_without_coordinates_show_kd_instead_of_the_image() {
    let obj = format!("{TEXTURED}f 3 2 1\nf 1/1 2/2 3\n");
    let toml = format!("{CAMERA}{MESH}");
    let files: [(&str, &[u8]); 4] = [
        ("s.toml", toml.as_bytes()),
        ("m.obj", obj.as_bytes()),
        ("m.mtl", b"newmtl a\nKd 0.5 0.5 0.5\nmap_Kd t.png\n"),
        ("t.png", &png(1, 1, &[[255; 3]])),
    ];
    let scene = Folder::new(&files).load("s.toml").unwrap();
    assert!(warns(&scene, "lack texture coordinates"));
    for triangle in &scene.mesh.triangles {
        let material = &scene.materials[triangle.material as usize];
        assert_eq!(material.texture(Parameter::Diffuse).is_some(), triangle.uvs != [NONE; 3]);
    }
    assert_eq!(scene.materials[1].diffuse, Vec3::splat(0.5));
}

fn environment(file: &str, bytes: &[u8], more: &str) -> Result<Scene, SceneError> {
    let toml = format!("{CAMERA}{MESH}[environment]\nfile = \"{file}\"\n{more}");
    let files: [(&str, &[u8]); 3] = [("s.toml", toml.as_bytes()), ("m.obj", TRIANGLE.as_bytes()), (file, bytes)];
    Folder::new(&files).load("s.toml")
}

fn radiance(scene: &Scene) -> &[Vec3] {
    match &scene.environment {
        Environment::LatLong(map) => {
            assert_eq!(map.radiance.len(), (map.width * map.height) as usize);
            &map.radiance
        }
        other => panic!("not an image: {other:?}"),
    }
}

#[test]
fn environments_come_in_every_sample_type() {
    let f = |x: usize, y: usize| [x as f32, y as f32 + 0.5, 3.0];
    let scene = environment("sky.exr", &exr((3, 2), f), "scale = 2.0\n").unwrap();
    assert_eq!(radiance(&scene)[0], vec3(0.0, 1.0, 6.0));
    assert_eq!(radiance(&scene)[5], vec3(4.0, 3.0, 6.0));

    let h = |x, y| f(x, y).map(half::f16::from_f32);
    let scene = environment("sky.exr", &exr((3, 2), h), "").unwrap();
    assert_eq!(radiance(&scene)[5], vec3(2.0, 1.5, 3.0));

    let u = |x: usize, _| [x as u32, 7, 100_000];
    let scene = environment("sky.exr", &exr((2, 1), u), "").unwrap();
    assert_eq!(radiance(&scene)[1], vec3(1.0, 7.0, 1e5));

    let scene = environment("sky.hdr", &hdr(2, 1, &[[8.0, 4.0, 2.0]; 2]), "").unwrap();
    assert_eq!(radiance(&scene)[1], vec3(8.0, 4.0, 2.0));

    let scene = environment("sky.png", &png(1, 1, &[[188; 3]]), "").unwrap();
    assert!((radiance(&scene)[0].x - 0.502886).abs() < 1e-5);
}

/// One reader: a file is the same light as a sky, as a texture and to whoever compares images.
#[test]
fn a_sky_is_what_the_image_file_holds() {
    use exr::prelude::*;

    let luminance = |at: Vec2<usize>| (0.25 + at.x() as f32,);
    let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(luminance);
    let mut grey = Cursor::new(Vec::new());
    Image::from_channels((3, 1), channels).write().to_buffered(&mut grey).unwrap();
    let exposed = b"#?RGBE\nEXPOSURE=2.0\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n\x80\x40\x20\x81";
    let codes = image::RgbImage::from_fn(4, 3, |x, y| image::Rgb([60 * x as u8, 80 * y as u8, 200]));
    let encoded = |format| {
        let mut bytes = Cursor::new(Vec::new());
        codes.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let files = [
        ("grey.exr", grey.into_inner()),
        ("exposed.hdr", exposed.to_vec()),
        ("codes.png", encoded(image::ImageFormat::Png)),
        ("codes.jpg", encoded(image::ImageFormat::Jpeg)),
        ("codes.tga", encoded(image::ImageFormat::Tga)),
        ("codes.bmp", encoded(image::ImageFormat::Bmp)),
    ];
    for (name, bytes) in files {
        let folder = Folder::new(&[(name, &bytes)]);
        let pixels = raywave::image::read_image(&folder.path(name)).unwrap().pixels;
        let scene = environment(name, &bytes, "").unwrap();
        assert_eq!(radiance(&scene), pixels, "{name}");
        match name {
            "grey.exr" => assert_eq!(pixels, [0.25, 1.25, 2.25].map(Vec3::splat)),
            "exposed.hdr" => assert_eq!(pixels, [vec3(0.5, 0.25, 0.125)]),
            _ => assert_eq!(pixels.len(), 12, "{name}"),
        }
    }
    // A wrong extension is common among textures, so a scene goes by the contents.
    let scene = environment("really.png", &encoded(image::ImageFormat::Jpeg), "").unwrap();
    assert_eq!(radiance(&scene).len(), 12);
}

#[test]
fn a_black_environment_is_none() {
    let scene = environment("sky.png", &png(2, 1, &[[0; 3]; 2]), "").unwrap();
    assert!(matches!(scene.environment, Environment::Black));
    assert!(warns(&scene, "s.toml:8: the environment is black"));
    let scene = scene_with("[environment]\nradiance = [0, 0, 0]\n", TRIANGLE, "");
    assert!(matches!(scene.environment, Environment::Black));
}

// The gallery

#[test]
fn the_gallery_is_rich_and_the_same_each_time() {
    let [first, second] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let load = |folder: &TempDir| {
        generate_gallery(folder.path(), 60_000).unwrap();
        Scene::load(&folder.path().join("gallery.toml")).unwrap()
    };
    let scene = load(&first);
    assert_eq!(scene.hash, load(&second).hash);
    assert_eq!(scene.warnings, [""; 0]);
    assert_eq!((scene.settings.width, scene.settings.height), (960, 540));
    assert!(scene.mesh.triangles.len().abs_diff(60_000) < 600);
    let emitters = scene.materials.iter().filter(|material| material.is_emitter());
    assert!(emitters.count() >= 5);
    assert!(scene.materials.len() >= 25);
    for surface in [Surface::Glossy, Surface::Mirror, Surface::Refractive, Surface::Dielectric] {
        assert!(scene.materials.iter().any(|material| material.surface == surface));
    }
    assert!(matches!(scene.environment, Environment::LatLong(_)));
    assert!(!scene.textures.is_empty() && !scene.mesh.normals.is_empty());
    // Smooth normals agree with the winding: none points through its own surface.
    for triangle in scene.mesh.triangles.iter().filter(|t| t.normals != [NONE; 3]) {
        let [a, b, c] = triangle.positions.map(|index| scene.mesh.positions[index as usize]);
        let geometric = (b - a).cross(c - a);
        let sum: Vec3 = triangle.normals.map(|n| scene.mesh.normals[n as usize]).iter().sum();
        assert!(geometric.dot(sum.as_dvec3()) > 0.0);
    }
    let names: Vec<_> = fs::read_dir(first.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names.len(), 5, "no partial file stays: {names:?}");
}

#[test]
fn a_gallery_that_cannot_be_written_says_where() {
    let folder = Folder::new(&[("file", "")]);
    let error = generate_gallery(&folder.path("file"), 1000).unwrap_err();
    assert!(error.to_string().contains("file: cannot be written"), "{error}");
}

// Malformed input

/// Files that are refused, where the message points, and a phrase from it.
struct Refused {
    files: Vec<(&'static str, Vec<u8>)>,
    at: &'static str,
    says: &'static str,
}

fn toml(text: &str, at: &'static str, says: &'static str) -> Refused {
    let files = vec![("s.toml", text.into()), ("m.obj", TRIANGLE.into())];
    Refused { files, at, says }
}

/// A valid camera and mesh, lines 1 to 6, and more.
fn more(text: &str, at: &'static str, says: &'static str) -> Refused {
    toml(&format!("{CAMERA}{MESH}{text}"), at, says)
}

fn obj(text: &str, at: &'static str, says: &'static str) -> Refused {
    let scene = format!("{CAMERA}{MESH}");
    let files = vec![("s.toml", scene.into()), ("m.obj", text.into())];
    Refused { files, at, says }
}

fn mtl(text: &str, at: &'static str, says: &'static str) -> Refused {
    let mut refused = obj(TEXTURED, at, says);
    refused.files.push(("m.mtl", text.into()));
    refused
}

fn sky(file: &'static str, bytes: Vec<u8>, at: &'static str, says: &'static str) -> Refused {
    let mut refused = more(&format!("[environment]\nfile = '{file}'\n"), at, says);
    refused.files.push((file, bytes));
    refused
}

fn refused() -> Vec<Refused> {
    let camera = |line: &str| format!("[camera]\n{line}\n{MESH}");
    let placed = |line: &str| format!("{CAMERA}{MESH}{line}\n");
    let half_exr = exr((2, 2), |_, _| [1.0f32; 3]);
    let half_exr = half_exr[..half_exr.len() / 2].to_vec();
    let with_image = |image: Vec<u8>, says| {
        let mut refused = mtl("newmtl a\nKd 1 1 1\nmap_Kd t.png\n", "m.mtl:3", says);
        refused.files.push(("t.png", image));
        refused
    };
    vec![
        // TOML
        toml("", "s.toml", "no [camera]"),
        toml("[camera\n", "s.toml:1", "see the scene format"),
        toml(&format!("{CAMERA}[film]\nwidth = 1\nwidth = 2\n"), "s.toml:7", "duplicate"),
        toml(CAMERA, "s.toml", "no [[mesh]]"),
        toml(&camera("eye = [0, 0]\ntarget = [0, 0, 0]\nvfov = 40"), "s.toml:2", "length 2"),
        toml(&camera("target = [0, 0, 0]\nvfov = 40"), "s.toml:1", "missing field `eye`"),
        toml(&camera("eye = [0, 0, 1]\ntarget = [0, 0, 1]\nvfov = 40"), "s.toml:3", "equals eye"),
        toml(&camera("eye = [0, nan, 1]\ntarget = [0, 0, 1]\nvfov = 40"), "s.toml:2", "not finite"),
        toml(&format!("{CAMERA}up = [0, 0, 0]\n{MESH}"), "s.toml:5", "up is zero"),
        toml(&format!("{CAMERA}roll = 1\n{MESH}"), "s.toml:5", "unknown field `roll`"),
        toml(&camera("eye = [0, 0, 5]\ntarget = [0, 0, 0]\nvfov = 180"), "s.toml:4", "vfov"),
        toml(&camera("eye = [0, 0, 5]\ntarget = [0, 0, 0]\nvfov = 'x'"), "s.toml:4", "expected f64"),
        toml(&format!("{CAMERA}aperture = -1\n{MESH}"), "s.toml:5", "aperture"),
        toml(&format!("{CAMERA}aperture = 0.1\n{MESH}"), "s.toml:5", "needs focus"),
        toml(&format!("{CAMERA}focus = 0.0\n{MESH}"), "s.toml:5", "focus is not a distance"),
        more("[film]\nwidth = 0\n", "s.toml:8", "width is outside"),
        more("[film]\nwidth = 8\nheight = 70000\n", "s.toml:9", "height is outside"),
        more("[render]\nintegrator = 'photons'\n", "s.toml:8", "`implicit`, `explicit` or `mis`"),
        more("[render]\nsampler = 'halton'\n", "s.toml:8", "`independent` or `sobol`"),
        more("[render]\nsamples = 0\n", "s.toml:8", "samples"),
        more("[render]\nmax_bounces = -2\n", "s.toml:8", "max_bounces"),
        more("[render]\nmax_bounces = -1\n", "s.toml:8", "need roulette"),
        more("[render]\nroulette = 1.0\n", "s.toml:8", "roulette is outside"),
        more("[renderer]\n", "s.toml:7", "unknown field `renderer`"),
        more("[environment]\n", "s.toml:7", "needs radiance or file"),
        more("[environment]\nradiance = [1, -1, 1]\n", "s.toml:8", "negative"),
        more("[environment]\nradiance = [1, 1, 1]\nscale = 2\n", "s.toml:9", "multiply radiance"),
        more("[environment]\nradiance = [1, 1, 1]\nfile = 'a.exr'\n", "s.toml:9", "exclude"),
        more("[environment]\nfile = 'nowhere.exr'\n", "s.toml:8", "nowhere.exr"),
        more("[environment]\nfile = 'a.exr'\nscale = -1\n", "s.toml:9", "scale is negative"),
        more("[material.a]\nKd = [1, 2]\n", "s.toml:8", "Kd has 2 numbers"),
        more("[material.a]\nKs = 'red'\n", "s.toml:8", "expected a number"),
        more("[material.a]\nNi = 0\n", "s.toml:8", "Ni is 0"),
        more("[material.a]\nKa = 0\n", "s.toml:8", "unknown field `Ka`"),
        toml(&placed("scale = [1, 0, 1]"), "s.toml:7", "flattens"),
        toml(&placed("scale = [1, 2]"), "s.toml:7", "one number, or three"),
        toml(&placed("rotate = [0, inf, 0]"), "s.toml:7", "rotate is not finite"),
        toml(&placed("translate = [0, 1e31, 0]"), "s.toml:7", "translate"),
        toml(&format!("{CAMERA}[[mesh]]\nfile = 'no.obj'\n"), "s.toml:6", "no.obj"),
        toml(&format!("{CAMERA}[[mesh]]\nscale = 1\n"), "s.toml:5", "missing field `file`"),
        Refused { files: vec![("s.toml", b"[camera]\n\xff".to_vec())], at: "s.toml:2", says: "UTF-8" },
        // OBJ
        obj("", "m.obj", "no faces"),
        obj("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "m.obj", "no faces"),
        obj("v 0 0\n", "m.obj:1", "needs 3 numbers and has 2"),
        obj("v 0 0 0\nv 0 zero 0\n", "m.obj:2", "`zero` is not a number"),
        obj("v 0 0 0\n\nv 0 nan 0\nv 1 0 0\nf 1 2 3\n", "m.obj:3", "not finite"),
        obj("v 0 0 1e999\nf 1 1 1\n", "m.obj:1", "not finite"),
        obj("version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "m.obj", "a Git LFS pointer"),
        obj("<!DOCTYPE html>\n<html></html>\n", "m.obj", "a web page"),
        obj("v 0 0 0\nvt\n", "m.obj:2", "needs 2 numbers"),
        obj("v 0 0 0\nvn 0 1\n", "m.obj:2", "a normal needs 3"),
        obj("v 0 0 0\nf 1 1\n", "m.obj", "no faces"),
        obj(&format!("{TRIANGLE}f 0 1 2\n"), "m.obj:5", "index 0"),
        obj(&format!("{TRIANGLE}f 1 2 4\n"), "m.obj:5", "vertex index 4 is out of range"),
        obj(&format!("{TRIANGLE}f 1 2 -4\n"), "m.obj:5", "only 3 stand above"),
        obj(&format!("{TRIANGLE}f a b c\n"), "m.obj:5", "`a` is not a vertex index"),
        obj(&format!("{TRIANGLE}f 1.5 2 3\n"), "m.obj:5", "`1.5` is not a vertex index"),
        obj(&format!("{TRIANGLE}f 1///1 2 3\n"), "m.obj:5", "too many slashes"),
        obj(&format!("{TRIANGLE}f / 2 3\n"), "m.obj:5", "has no vertex"),
        obj(&format!("{TRIANGLE}f 99999999999999999999 2 3\n"), "m.obj:5", "not a vertex index"),
        obj("v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n", "s.toml", "no triangle has an area"),
        obj("v 0 0 0\nv 1e40 0 0\nv 0 1 0\nf 1 2 3\n", "m.obj", "beyond 1e30"),
        // MTL
        mtl("newmtl a\nKd\n", "m.mtl:2", "Kd has 0 numbers"),
        mtl("newmtl a\nKd red\n", "m.mtl:2", "`red` is not a number"),
        mtl("newmtl a\nKd 0.5 -0.5 0.5\n", "m.mtl:2", "Kd is negative"),
        mtl("newmtl a\n\nKs nan 0 0\n", "m.mtl:3", "Ks is not finite"),
        mtl("newmtl a\nKe 1e39 0 0\n", "m.mtl:2", "Ke is not finite"),
        mtl("newmtl a\nNs -1\nKs 1 1 1\n", "m.mtl:2", "Ns is -1"),
        mtl("newmtl a\nNi -1.5\nillum 7\n", "m.mtl:2", "Ni is -1.5"),
        mtl("newmtl a\nillum 1.5\n", "m.mtl:2", "whole number"),
        mtl("newmtl a\nillum glass\n", "m.mtl:2", "`glass` is not a number"),
        // Images
        with_image(b"not an image".to_vec(), "cannot be decoded"),
        with_image(png(4, 4, &[[9; 3]; 16])[..60].to_vec(), "cannot be decoded"),
        sky("a.exr", half_exr, "s.toml:8", "cannot be decoded"),
        sky("a.xyz", b"what".to_vec(), "s.toml:8", "no known image format"),
    ]
}

#[test]
fn what_is_wrong_is_said_in_one_line_with_its_place() {
    let cases = refused();
    assert!(cases.len() >= 35);
    let mut failures = Vec::new();
    for case in cases {
        let files: Vec<_> = case.files.iter().map(|(name, bytes)| (*name, bytes)).collect();
        let folder = Folder::new(&files);
        let place = format!("{}: ", folder.path(case.at).display());
        let message = match folder.load("s.toml") {
            Ok(_) => "accepted".to_owned(),
            Err(error) => error.to_string(),
        };
        let is_right = message.starts_with(&place)
            && message.contains(case.says)
            && message.contains("; ")
            && !message.contains('\n');
        if !is_right {
            failures.push(format!("{}: {}: {message}", case.at, case.says));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn vertices_have_colours() {
    // Three numbers behind a position are a colour in sRGB; a weight, or a weight and a colour, are none.
    let scene = scene_of("v 0 0 -3 1\nv 1 0 -3 1 0 0.5\nv 0 1 -3 1 0 1 0\nv 1 1 -3 0 0 0\nf 1 2 3\nf 2 4 3\n", "");
    let half = (((0.5 + 0.055) / 1.055_f64).powf(2.4)) as f32;
    let colours: Vec<Vec3> = (0..4).map(|position| scene.mesh.colour(position)).collect();
    assert!((colours[1].z - half).abs() < 1e-6);
    assert_eq!(colours, [Vec3::ONE, Vec3::new(1.0, 0.0, colours[1].z), Vec3::ONE, Vec3::ZERO]);
    // White is no colour.
    assert!(scene_of("v 0 0 -3 1 1 1\nv 1 0 -3\nv 0 1 -3\nf 1 2 3\n", "").mesh.colours.is_empty());
}

/// A face that is seen whatever else is wrong, and what is: the warning that tells of it, and the place of the first.
#[test]
fn what_a_scene_can_be_shown_without_is_told_once_a_kind() {
    let obj = |text: &str| scene_of(&format!("{TRIANGLE}{text}"), "");
    for (text, at, says) in [
        ("usemtl\nf 1 2 3\nusemtl\nf 1 2 3\n", 5, "usemtl names no material"),
        ("mtllib\nmtllib\n", 5, "mtllib names no file"),
        ("f 1/1 2/2 3/3\nf 1 2 3\n", 5, "texture coordinate index 1 is out of range"),
        ("vn 0 0 1\nf 1//0 2//1 3//1\nf 1//9 2//1 3//1\n", 6, "normal index 0; OBJ counts from 1"),
        ("vt nan 0\nvt 1.#IND 0\nf 1/1 2/2 3/1\n", 7, "a texture coordinate that is not finite"),
        ("vn 0 0 -nan(ind)\nf 1//1 2//1 3//1\n", 6, "a normal that is not finite"),
        ("f 1 2\nf\nf 3\n", 5, "a face with 2 corners is left out"),
        ("v 0 0 0 1 0 2\nv 0 0 0 -1 0 0\n", 5, "colours of vertices are clamped"),
    ] {
        let scene = obj(text);
        assert!(warns(&scene, &format!("m.obj:{at}: {says}")), "{says}: {:?}", scene.warnings);
        assert_eq!(
            scene.warnings.iter().filter(|warning| warning.contains("m.obj:")).count(),
            1,
            "{:?}",
            scene.warnings
        );
        for triangle in &scene.mesh.triangles {
            assert_eq!((triangle.uvs, triangle.normals), ([NONE; 3], [NONE; 3]), "{says}");
        }
    }
    assert!(warns(&obj("f 1 2\nf\nf 3\n"), "(the first of 3)"));
    // Not even that: nothing has it.
    assert!(!warns(&obj("v nan 0 0\nvt -nan(ind) 1\nvn 1.#QNAN 0 0\n"), "m.obj"));

    for (text, says) in [
        ("Kd 1 0 0\nnewmtl a\n", "m.mtl:1: Kd belongs to no material"),
        ("newmtl a\nKd 0.25 0.5\n", "m.mtl:2: Kd has two numbers"),
        ("newmtl a\nKd 0.1 0.2 0.3 1\n", "m.mtl:2: Kd has 4 numbers, of which 3 count"),
        ("newmtl a\nNs 1 2\n", "m.mtl:2: Ns has 2 numbers"),
        ("newmtl a\nKd spectral a.rfl\n", "m.mtl:2: Kd: spectra are not read"),
        ("newmtl a\nmap_bump a.png\n", "m.mtl:2: `map_bump` is ignored"),
        ("newmtl a\nmap_d nowhere.png\n", "m.mtl:2: there is no image"),
        ("newmtl a\nmap_Ke nowhere.png\n", "m.mtl:2: there is no image"),
        ("newmtl a\nmap_Kd\n", "m.mtl:2: map_Kd has no file name"),
        ("newmtl a\nmap_Kd nowhere.png\n", "m.mtl:2: there is no image"),
        ("newmtl a\nKe 1 1 1\nmap_Kd nowhere.png\n", "m.mtl:1: a material with Ke is a light"),
    ] {
        let scene = scene_of(TEXTURED, text);
        assert!(warns(&scene, says), "{says}: {:?}", scene.warnings);
        assert!(scene.textures.is_empty());
    }
    // Values that no surface shows are of no account.
    for text in ["newmtl a\nNi 0\nNs -1\nTf nan\n", "newmtl a\nKe 1\nKd red\nKs -1\n", "newmtl a\nnewmtl b\nKd red\n"] {
        let scene = scene_of(LIT_TRIANGLE, text);
        assert!(!warns(&scene, "m.mtl"), "{text}: {:?}", scene.warnings);
    }
}

#[test]
fn texels_that_are_no_light_are_clamped_and_counted() {
    let sky = |x: usize, _| [[-1.0, 2.0, f32::NAN], [f32::INFINITY, 0.5, 4.0], [1.0; 3]][x];
    let scene = environment("sky.exr", &exr((3, 1), sky), "").unwrap();
    assert_eq!(radiance(&scene), [vec3(0.0, 2.0, 0.0), vec3(4.0, 0.5, 4.0), Vec3::ONE]);
    assert!(warns(&scene, "2 of 3 texels, the first at (0, 0)"), "{:?}", scene.warnings);
}

#[test]
fn a_model_stays_opaque_where_glass_is_not_described() {
    for mtl in ["illum 7", "illum 4\nd 1", "illum 6\nNi 1", "illum 9", "illum 4\nNi 1.45\nd 1.0"] {
        let scene = scene_of(LIT_TRIANGLE, &format!("newmtl a\nKd 0.8 0.1 0.1\n{mtl}\n"));
        assert_eq!(scene.materials[0].surface, Surface::Glossy, "{mtl}");
        assert!(scene.materials[0].diffuse.x > 0.5, "{mtl}");
        assert!(warns(&scene, "is taken to be opaque"), "{mtl}");
    }
    for mtl in ["illum 7\nNi 1.5", "illum 6\nNi 1.01", "illum 4\nNi 1.5\nd 0.5", "illum 4\nNi 1.5"] {
        let scene = scene_of(LIT_TRIANGLE, &format!("newmtl a\n{mtl}\n"));
        assert_ne!(scene.materials[0].surface, Surface::Glossy, "{mtl}");
    }
    // A table of the scene file has the last word.
    for (table, surface) in
        [("illum = 7", Surface::Dielectric), ("Ni = 1.5", Surface::Dielectric), ("Kd = 1", Surface::Glossy)]
    {
        let toml = format!("[material.a]\n{table}\n");
        let scene = scene_with(&toml, LIT_TRIANGLE, "newmtl a\nillum 7\n");
        assert_eq!(scene.materials[0].surface, surface, "{table}");
    }
}

#[test]
fn names_in_other_encodings_stay_apart_and_are_found() {
    let [red, green] = [b"\xba\xec".as_slice(), b"\xc2\xcc"];
    let obj = [
        b"mtllib ".as_slice(),
        green,
        b".mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl ",
        red,
        b"\nf 1 2 3\nusemtl ",
        green,
        b"\nf 1 2 3\n",
    ];
    let mtl = [b"newmtl ".as_slice(), red, b"\nKd 1 0 0\nnewmtl ", green, b"\nKd 0 1 0\nmap_bump x.png\n"];
    let folder = Folder::new(&[("m.obj", obj.concat())]);
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStrExt;
        let name = [green, b".mtl"].concat();
        fs::write(folder.0.path().join(std::ffi::OsStr::from_bytes(&name)), mtl.concat()).unwrap();
        let scene = folder.load("m.obj").unwrap();
        let kd: Vec<Vec3> = scene.materials.iter().map(|material| material.diffuse).collect();
        assert_eq!(kd, [Vec3::X, Vec3::Y]);
        assert!(!warns(&scene, "no material"), "{:?}", scene.warnings);
    }
}

#[test]
fn concave_polygons_are_covered_once_whatever_their_first_corner() {
    // A U of area 18 in a tilted plane.
    let outline =
        [[0, 0], [6, 0], [6, 4], [4, 4], [4, 1], [2, 1], [2, 4], [0, 4]].map(|[x, y]| dvec2(x.into(), y.into()));
    let tilt = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_y(1.1);
    for first in 0..8 {
        for reversed in [false, true] {
            let mut corners: Vec<_> = (0..8).map(|i| tilt * outline[(first + i) % 8].extend(0.25)).collect();
            if reversed {
                corners.reverse();
            }
            let text: String = corners.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z)).collect();
            let scene = scene_of(&format!("{text}f 1 2 3 4 5 6 7 8\n"), "");
            let normal = tilt * if reversed { DVec3::NEG_Z } else { DVec3::Z };
            let areas = (0..scene.mesh.triangles.len()).map(|triangle| {
                let [a, b, c] = self::corners(&scene, triangle);
                0.5 * (b - a).cross(c - a).dot(normal)
            });
            let areas: Vec<f64> = areas.collect();
            assert!(areas.iter().all(|area| *area > 0.0), "{areas:?}");
            assert!((areas.iter().sum::<f64>() - 18.0).abs() < 1e-9, "{areas:?}");
        }
    }
}

#[test]
fn lines_may_end_in_carriage_returns_alone() {
    let scene = Folder::new(&[("m.obj", TRIANGLE.replace('\n', "\r"))]).load("m.obj").unwrap();
    assert_eq!(scene.mesh.triangles.len(), 1);
}

#[test]
fn images_lie_where_the_options_say() {
    let image = png(1, 1, &[[255; 3]]);
    let scene = textured("newmtl a\nmap_Kd -s 2 3 1 -o 0.5 t.png\n", "t.png", &image);
    let transform = scene.textures[0].lookup.transform;
    assert_eq!(transform, Affine2::from_scale_angle_translation(vec2(2.0, 3.0), 0.0, vec2(0.5, 0.0)));
}

#[test]
fn large_files_mean_what_small_ones_do() {
    // Of several megabytes, so that parts of it are read apart.
    const COUNT: usize = 120_000;
    let mut obj = String::from("mtllib none.mtl\nv 9 9 9\n");
    for index in 0..COUNT {
        let material = ["a", "b", "a", "c"][index * 4 / COUNT];
        if index % (COUNT / 8) == 0 {
            obj += &format!("usemtl {material}\n");
        }
        let (x, y) = (index % 400, index / 400);
        obj += &format!("v {x} {y} 0\nv {}.5 {y} 0\nv {x} {y}.5 0\nf -3 \\\n -2 -1\n", x);
        if index % 1000 == 999 {
            obj += "f 1 2\nf 1 2/7 3\n";
        }
    }
    let scene = Folder::new(&[("m.obj", &obj)]).load("m.obj").unwrap();
    assert_eq!(scene.materials.iter().map(|material| &material.name[..]).collect::<Vec<_>>(), ["a", "b", "c"]);
    let own: Vec<_> = scene.mesh.triangles.iter().filter(|triangle| !triangle.positions.contains(&0)).collect();
    assert_eq!(own.len(), COUNT);
    for (index, triangle) in own.iter().enumerate() {
        let first = 1 + 3 * index as u32;
        assert_eq!(triangle.positions, [first, first + 1, first + 2]);
        assert_eq!(triangle.material, [0, 1, 0, 2][index * 4 / COUNT]);
        let corner = scene.mesh.positions[first as usize];
        assert_eq!(corner, dvec3((index % 400) as f64, (index / 400) as f64, 0.0));
    }
    assert!(warns(&scene, "m.obj:5004: a face with 2 corners is left out; give 3 or more (the first of 120)"));
    assert!(warns(&scene, "m.obj:5005: texture coordinate index 7 is out of range"));

    // The first error is told, of vertices before faces, with its line.
    let lines = obj.lines().count();
    let wrong = format!("{obj}f 1 2 0\n{obj}f 1 2 x\n");
    let error = Folder::new(&[("m.obj", &wrong)]).load("m.obj").unwrap_err().to_string();
    assert!(error.contains(&format!("m.obj:{}: vertex index 0", lines + 1)), "{error}");
    let error =
        Folder::new(&[("m.obj", format!("{wrong}v 1 y 2\n{obj}v z 1 2\n"))]).load("m.obj").unwrap_err().to_string();
    assert!(error.contains(&format!("m.obj:{}: `y` is not a number", 2 * lines + 3)), "{error}");
}

#[test]
fn colours_may_be_given_as_cie_xyz() {
    let white = material_of("newmtl a\nKd xyz 0.9505 1.0 1.089\n");
    assert!((white.diffuse - Vec3::ONE).abs().max_element() < 2e-3, "{}", white.diffuse);
}

#[test]
fn other_extensions_and_missing_files_are_refused() {
    let folder = Folder::new(&[("a.stl", "")]);
    let error = folder.load("a.stl").unwrap_err().to_string();
    assert!(error.contains("a.stl: neither .toml, .xml, .gltf, .glb, .obj nor .ply"), "{error}");
    let error = folder.load("b.toml").unwrap_err();
    assert_eq!(error.location.line, None);
    assert!(error.to_string().contains("b.toml: cannot read"), "{error}");
}

#[test]
fn names_with_line_breaks_do_not_break_the_message() {
    let toml = format!("{CAMERA}[[mesh]]\nfile = \"no\\nsuch\\nfile.obj\"\n");
    let error = Folder::new(&[("s.toml", toml)]).load("s.toml").unwrap_err();
    assert!(!error.to_string().contains('\n'));
}

// Never a panic

/// Applies edits, each a place and what to put there: a byte, a cut, or a copy of what comes after.
fn mutated(mut bytes: Vec<u8>, edits: &[(prop::sample::Index, u8, u8)]) -> Vec<u8> {
    for (place, kind, value) in edits {
        if bytes.is_empty() {
            break;
        }
        let at = place.index(bytes.len());
        match kind % 4 {
            0 => bytes[at] = *value,
            1 => bytes.insert(at, b"-/ 0\n19.#"[usize::from(*value) % 9]),
            2 => bytes.truncate(at.max(bytes.len() / 2)),
            _ => {
                let copy = bytes[at..(at + usize::from(*value)).min(bytes.len())].to_vec();
                bytes.splice(at..at, copy);
            }
        }
    }
    bytes
}

fn edits() -> impl Strategy<Value = Vec<(prop::sample::Index, u8, u8)>> {
    prop::collection::vec(any::<(prop::sample::Index, u8, u8)>(), 0..6)
}

/// Loads whatever it is; a scene that comes out must keep its promises.
fn load_any(files: &[(&str, Vec<u8>)], name: &str) {
    match Folder::new(files).load(name) {
        Err(error) => assert!(!error.to_string().contains('\n')),
        Ok(scene) => {
            assert!(!scene.mesh.triangles.is_empty());
            assert!(scene.mesh.positions.iter().all(|p| p.is_finite()));
            let within = |indices: [u32; 3], count: usize| {
                indices == [NONE; 3] || indices.iter().all(|&index| (index as usize) < count)
            };
            for triangle in &scene.mesh.triangles {
                assert!(triangle.positions.iter().all(|&i| (i as usize) < scene.mesh.positions.len()));
                assert!(within(triangle.normals, scene.mesh.normals.len()));
                assert!(within(triangle.uvs, scene.mesh.uvs.len()));
                let material = &scene.materials[triangle.material as usize];
                assert!((material.diffuse + material.specular).max_element() <= 1.0001);
                assert!(material.texture(Parameter::Diffuse).is_none_or(|map| (map as usize) < scene.textures.len()));
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 192,
        failure_persistence: None,
        ..Default::default()
    })]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        load_any(&[("m.obj", bytes.clone())], "m.obj");
        load_any(&[("s.toml", bytes.clone())], "s.toml");
        load_any(&[("m.obj", LIT_TRIANGLE.into()), ("m.mtl", bytes)], "m.obj");
    }

    #[test]
    fn random_statements_never_panic(
        lines in prop::collection::vec("(v|vt|vn|f|usemtl|mtllib|o|l|)( -?[0-9]{1,3}(\\.5|/-?[0-9]|//[0-9])?){0,5}", 0..30),
    ) {
        load_any(&[("m.obj", format!("{TRIANGLE}{}", lines.join("\n")).into())], "m.obj");
    }

    #[test]
    fn mutated_scenes_never_panic(scene in edits(), mesh in edits(), materials in edits()) {
        let toml = format!(
            "{CAMERA}{MESH}scale = [1, 2, 3]\n[material.a]\nKs = 0.5\n[render]\nsamples = 4\n"
        );
        let mtl = "newmtl a\nKd 0.5 0.5 0.5\nNs 10\nillum 2\nKe 1 1 1\n";
        let obj = "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n\
                   f 1/1/1 2/1/1 3/1/1\nf -3//-1 -2//-1 -1//-1\nusemtl b\nf 1 2 3\n";
        let files = [
            ("s.toml", mutated(toml.into(), &scene)),
            ("m.obj", mutated(obj.into(), &mesh)),
            ("m.mtl", mutated(mtl.into(), &materials)),
        ];
        load_any(&files, "s.toml");
        load_any(&files, "m.obj");
    }

    #[test]
    fn mutated_images_never_panic(edits in edits(), which in 0..3usize) {
        let bytes = match which {
            0 => exr((9, 7), |x, y| [x as f32, y as f32, 1.0]),
            1 => hdr(9, 7, &[[1.0, 2.0, 3.0]; 63]),
            _ => png(9, 7, &[[1, 2, 3]; 63]),
        };
        let name = ["a.exr", "a.hdr", "a.png"][which];
        let toml = format!("{CAMERA}{MESH}[environment]\nfile = '{name}'\n");
        let files = [
            ("s.toml", toml.into()),
            ("m.obj", TRIANGLE.into()),
            (name, mutated(bytes, &edits)),
        ];
        load_any(&files, "s.toml");
    }
}

#[test]
fn roughness_metal_and_opacity_are_shown() {
    // As Blender writes a metal, and with its PBR keys.
    let blender = "newmtl a\nNs 250\nKa 1 1 1\nKd 0.8 0.1 0.1\nKs 0.5 0.5 0.5\nNi 1.45\nd 1\nillum 3\n";
    let metal = &scene_of(LIT_TRIANGLE, blender).materials[0];
    assert_eq!((metal.surface, metal.metalness, metal.diffuse.x), (Surface::MetalRough, 1.0, 0.8));
    assert!((metal.roughness.x - 0.25).abs() < 1e-6, "Ns is 1000 times the square of what roughness leaves of 1");
    let metal = &scene_of(LIT_TRIANGLE, "newmtl a\nKd 0.5\nPr 0.3\nPm 0.7\nPc 0.2\nPcr 0.1\nillum 2\n").materials[0];
    assert_eq!((metal.surface, metal.metalness, metal.coat), (Surface::MetalRough, 0.7, 0.2));
    assert!((metal.roughness.y - 0.09).abs() < 1e-6 && (metal.coat_roughness - 0.01).abs() < 1e-6);
    // A mirror that is described as one stays one, and glass may be rough.
    let mirror = &scene_of(LIT_TRIANGLE, "newmtl a\nillum 3\nKs 0.9\n").materials[0];
    assert_eq!(mirror.surface, Surface::Mirror);
    let glass = &scene_of(LIT_TRIANGLE, "newmtl a\nillum 7\nNi 1.5\nPr 0.5\n").materials[0];
    assert_eq!((glass.surface, glass.is_rough()), (Surface::Dielectric, true));

    for text in ["newmtl a\nKd 0.5\nd 0.25\n", "newmtl a\nKd 0.5\nTr 0.75\n"] {
        let scene = scene_of(LIT_TRIANGLE, text);
        let blend =
            scene.materials.iter().find(|m| matches!(m.surface, Surface::Blend(..))).expect("it is transparent");
        let Surface::Blend(opaque, nothing) = blend.surface else { unreachable!() };
        assert_eq!(blend.weight, 0.25);
        assert_eq!(scene.materials[opaque as usize].diffuse.x, 0.5);
        assert_eq!(scene.materials[nothing as usize].surface, Surface::Nothing);
    }
    for text in ["newmtl a\nd 1\n", "newmtl a\nd 0.5\nillum 7\nNi 1.5\n", "newmtl a\nd 0.5\nKe 1\n"] {
        let scene = scene_of(LIT_TRIANGLE, text);
        assert!(scene.materials.iter().all(|m| !matches!(m.surface, Surface::Blend(..))), "{text}");
        assert_eq!(warns(&scene, "is not shown: it is glass or a light"), text.contains("d 0.5"), "{text}");
    }
}
