//! PLY and glTF files made in code: what they mean, against the same things said otherwise, and what is said about files that
//! break them. None may panic.

use std::f64::consts::FRAC_1_SQRT_2;
use std::fs;
use std::path::PathBuf;

use glam::{DVec3, Vec2, Vec3, dvec3, vec2};
use raywave::scene::{
    Falloff, Light, LoadOptions, MeshFormat, NONE, Parameter, Scene, SceneError, SceneFiles, Surface, Wrap,
};
use serde_json::{Value, json};
use tempfile::TempDir;

/// A folder of scene files that lives as long as the value.
struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn with(self, name: &str, contents: impl AsRef<[u8]>) -> Self {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, contents).unwrap();
        self
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn load(&self, name: &str) -> Result<Scene, SceneError> {
        Scene::load(&self.path(name))
    }
}

fn load(name: &str, contents: impl AsRef<[u8]>) -> Result<Scene, SceneError> {
    Folder::new().with(name, contents).load(name)
}

fn corners(scene: &Scene) -> Vec<[DVec3; 3]> {
    let triangles = scene.mesh.triangles.iter();
    triangles.map(|triangle| triangle.positions.map(|index| scene.mesh.positions[index as usize])).collect()
}

fn warns(scene: &Scene, phrase: &str) -> bool {
    assert!(scene.warnings.iter().all(|warning| !warning.contains('\n')), "{:?}", scene.warnings);
    scene.warnings.iter().any(|warning| warning.contains(phrase))
}

fn assert_warns(scene: &Scene, phrase: &str) {
    assert!(warns(scene, phrase), "no `{phrase}` in {:?}", scene.warnings);
}

fn close(a: DVec3, b: DVec3) -> bool {
    a.distance(b) < 1e-6
}

fn png(rgba: [u8; 4]) -> Vec<u8> {
    let image = image::RgbaImage::from_pixel(1, 1, image::Rgba(rgba));
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

// PLY

/// A square with normals, texture coordinates and colours, and an element and properties of no meaning here.
const PLY_HEADER: &str = "comment made by hand\nobj_info nothing\nelement vertex 4\nproperty float x\nproperty double y\n\
    property short z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty list uchar float neighbours\n\
    property float s\nproperty float t\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
    element camera 1\nproperty float view\nelement face 2\nproperty uchar flags\n\
    property list ushort int vertex_indices\nend_header\n";
const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

fn ply_text() -> Vec<u8> {
    let mut text = format!("ply\nformat ascii 1.0\n{PLY_HEADER}");
    for [x, y] in SQUARE {
        text += &format!("{x} {y} -3 0 0 1 2 7.5 8.5 {x} {y} 255 0 188\n");
    }
    (text + "1\n0 4 0 1 2 3\n9 3 0 1\n2\n").into_bytes()
}

fn ply_binary(big: bool) -> Vec<u8> {
    let format = if big { "big" } else { "little" };
    let mut bytes = format!("ply\nformat binary_{format}_endian 1.0\n{PLY_HEADER}").into_bytes();
    let mut put = |mut number: Vec<u8>| {
        if big {
            number.reverse();
        }
        bytes.extend(number);
    };
    let float = |value: f64| (value as f32).to_le_bytes().to_vec();
    for [x, y] in SQUARE {
        put(float(x));
        put(y.to_le_bytes().to_vec());
        put((-3_i16).to_le_bytes().to_vec());
        [0.0, 0.0, 1.0].into_iter().for_each(|value| put(float(value)));
        put(vec![2]);
        [7.5, 8.5, x, y].into_iter().for_each(|value| put(float(value)));
        [255, 0, 188].into_iter().for_each(|value| put(vec![value]));
    }
    put(float(1.0));
    for (flags, face) in [(0, vec![0_i32, 1, 2, 3]), (9, vec![0, 1, 2])] {
        put(vec![flags]);
        put((face.len() as u16).to_le_bytes().to_vec());
        face.iter().for_each(|index| put(index.to_le_bytes().to_vec()));
    }
    bytes
}

#[test]
fn ply_is_the_same_mesh_in_all_encodings() {
    let [text, little, big] =
        [ply_text(), ply_binary(false), ply_binary(true)].map(|bytes| load("square.ply", bytes).unwrap());
    let points = SQUARE.map(|[x, y]| dvec3(x, y, -3.0));
    let expected = [[0, 1, 2], [0, 2, 3], [0, 1, 2]].map(|triangle| triangle.map(|index: usize| points[index]));
    // The sRGB signal 188 is half of the light.
    let pink = Vec3::new(1.0, 0.0, ((188.0 / 255.0 + 0.055) / 1.055_f64).powf(2.4) as f32);
    for scene in [&text, &little, &big] {
        assert_eq!(corners(scene), expected);
        assert!(scene.mesh.triangles.iter().all(|triangle| triangle.normals == triangle.positions));
        assert!(scene.mesh.normals.iter().all(|normal| *normal == Vec3::Z));
        assert_eq!(scene.materials[0].name, "square");
        assert_warns(scene, "the property `neighbours` of `vertex` is not shown (the first of 2)");
        assert_warns(scene, "elements `camera` are not shown");
        assert!(scene.mesh.colours.iter().any(|colour| colour.abs_diff_eq(pink, 1e-6)));
    }
    // White multiplies nothing.
    let white = String::from_utf8(ply_text()).unwrap().replace("255 0 188", "255 255 255");
    assert!(load("white.ply", white).unwrap().mesh.colours.is_empty());
}

#[test]
fn binary_ply_of_triangles_alone_is_the_same_mesh() {
    let header = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n\
        property list uchar int vertex_indices\nend_header\n";
    let binary = |big: bool, faces: [[i32; 3]; 2]| {
        let format = if big { "big" } else { "little" };
        let mut bytes = format!("ply\nformat binary_{format}_endian 1.0\n{header}").into_bytes();
        let order = |mut number: [u8; 4]| {
            if big {
                number.reverse();
            }
            number
        };
        for [x, y] in SQUARE {
            [x, y, 0.0].into_iter().for_each(|value| bytes.extend(order((value as f32).to_le_bytes())));
        }
        for face in faces {
            bytes.push(3);
            face.into_iter().for_each(|index| bytes.extend(order(index.to_le_bytes())));
        }
        bytes
    };
    let faces = [[0, 1, 2], [0, 2, 3]];
    let [a, b] = [false, true].map(|big| corners(&load("m.ply", binary(big, faces)).unwrap()));
    assert_eq!(a, b);
    assert_eq!(a, faces.map(|face| face.map(|index| SQUARE[index as usize]).map(|[x, y]| dvec3(x, y, 0.0))));
    // The second vertex has no x.
    let mut bad = binary(false, [[0, 2, 3], [0, 1, 2]]);
    let vertices = bad.windows(10).position(|window| window == b"end_header").unwrap() + 11;
    bad[vertices + 12..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    let error = load("m.ply", &bad).unwrap_err().to_string();
    assert!(error.ends_with("m.ply: vertex 1, counted from 0, is not finite; correct or remove it"), "{error}");
    let error = load("m.ply", binary(true, [[0, 1, 2], [0, -2, 7]])).unwrap_err().to_string();
    assert!(error.ends_with("m.ply: vertex index -2 is out of range; the file has 4, counted from 0"), "{error}");
}

#[test]
fn ply_of_strips_and_of_a_concave_polygon() {
    let vertices = "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n";
    let points = "0 0 0\n2 0 0\n0 2 0\n2 2 0\n1 0.5 0\n";
    let strips = format!(
        "ply\nformat ascii 1.0\n{vertices}element tristrips 1\nproperty list int int vertex_indices\nend_header\n{points}\
         8 0 1 2 3 -1 0 1 4\n"
    );
    let scene = load("strips.ply", strips).unwrap();
    assert_eq!(
        scene.mesh.triangles.iter().map(|triangle| triangle.positions).collect::<Vec<_>>(),
        [[0, 1, 2], [2, 1, 3], [0, 1, 4]]
    );
    let concave = format!(
        "ply\r\nformat ascii 1.0\r\n{}element face 1\r\nproperty list uchar int vertex_index\r\nend_header\r\n{points}\
         5 0 4 1 3 2\r\n",
        vertices.replace('\n', "\r\n")
    );
    let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).z;
    let areas: Vec<f64> = corners(&load("concave.ply", concave).unwrap()).into_iter().map(area).collect();
    assert!(areas.len() == 3 && areas.iter().all(|area| *area > 0.0), "{areas:?}");
    assert!((areas.iter().sum::<f64>() - 3.5).abs() < 1e-12, "{areas:?}");
}

#[test]
fn ply_in_a_scene_file_takes_a_material_table() {
    let toml = "[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nvfov = 40\n[[mesh]]\nfile = \"square.ply\"\n\
        scale = 2\ntranslate = [0, 0, 6]\n[material.square]\nKe = 3\n";
    let scene = Folder::new().with("s.toml", toml).with("square.ply", ply_text()).load("s.toml").unwrap();
    assert_eq!(corners(&scene)[0][1], dvec3(2.0, 0.0, 0.0));
    assert_eq!(scene.materials[0].emission, Vec3::splat(3.0));
}

#[test]
fn bad_ply_files_are_refused_in_one_line() {
    let vertices = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let face = "element face 1\nproperty list uchar int vertex_indices\n";
    let points = "0 0 0\n1 0 0\n0 1 0\n";
    let ascii = |rest: &str| format!("ply\nformat ascii 1.0\n{rest}");
    let whole = |body: &str| ascii(&format!("{vertices}{face}end_header\n{body}"));
    let cases = [
        (String::new(), "m.ply: not a PLY file"),
        ("v 0 0 0\n".to_owned(), "m.ply: not a PLY file but something else"),
        ("ply\n".to_owned(), "m.ply: a header without `end_header`"),
        ("plywood\n".to_owned(), "m.ply: a header without `end_header`"),
        (format!("ply\n{vertices}end_header\n"), "m.ply:6: no format above"),
        ("ply\nformat pdf 1.0\nend_header\n".to_owned(), "m.ply:2: no format `pdf`"),
        (ascii("element vertex many\nend_header\n"), "m.ply:3: `many` is not a number of elements"),
        (ascii("element vertex -3\nend_header\n"), "m.ply:3: `-3` is not a number of elements"),
        (ascii("property float x\nend_header\n"), "m.ply:3: a property of no element"),
        (ascii("element vertex 1\nproperty real x\nend_header\n"), "m.ply:4: no type `real`"),
        (ascii("element vertex 1\nproperty x\nend_header\n"), "m.ply:4: a property needs a type and a name"),
        (ascii("elephant vertex 1\nend_header\n"), "m.ply:3: `elephant vertex 1` is no line of a header"),
        (ascii("element vertex 1\nproperty float x\nend_header\n0\n"), "m.ply:3: vertices need x, y and z"),
        (ascii(&format!("{vertices}end_header\n{points}")), "m.ply: no faces"),
        (ascii(&format!("{face}{vertices}end_header\n3 0 1 2\n{points}")), "m.ply:3: faces stand above all vertices"),
        (ascii("element vertex 99999999999\nproperty float x\nend_header\n1\n"), "more than the file has bytes for"),
        (
            ascii(&format!(
                "{vertices}element face 4000000000\nproperty list uchar int vertex_indices\nend_header\n{points}3 0 1 2\n"
            )),
            "m.ply:7: 4000000000 elements `face` are more",
        ),
        (whole(&format!("{points}3 0 1 3\n")), "m.ply:13: vertex index 3 is out of range; the file has 3"),
        (whole(&format!("{points}3 0 1 -1\n")), "m.ply:13: vertex index -1 is out of range"),
        (whole(&format!("{points}3 0 1 1.5\n")), "m.ply:13: vertex index 1.5 is out of range"),
        (whole(&format!("{points}-3 0 1 2\n")), "m.ply:13: a list of -3 numbers"),
        (whole(&format!("{points}3 0 1\n")), "m.ply: the file ends early"),
        (whole(&format!("{points}4000000000 0 1 2\n")), "m.ply: the file ends early"),
        (whole("0 0 0\n1 zero 0\n0 1 0\n3 0 1 2\n"), "m.ply:11: `zero` is not a number"),
        (whole("0 0 0\n1 inf 0\n0 1 0\n3 0 1 2\n"), "m.ply:13: vertex 1, counted from 0, is not finite"),
        (whole(&format!("{points}2 0 1\n")), "m.ply: no faces"),
    ];
    for (text, expected) in cases {
        let error = load("m.ply", &text).unwrap_err().to_string();
        assert!(error.contains(expected) && !error.contains('\n'), "{text:?} says {error}");
    }
}

#[test]
fn torn_ply_files_never_panic() {
    for bytes in [ply_text(), ply_binary(false), ply_binary(true)] {
        for end in 0..bytes.len() {
            if let Err(error) = load("m.ply", &bytes[..end]) {
                assert!(!error.to_string().contains('\n'), "{error}");
            }
        }
    }
}

// glTF

/// A glTF document in the making, whose numbers are in one binary chunk.
#[derive(Default)]
struct Gltf {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    rest: Value,
}

impl Gltf {
    fn new(rest: Value) -> Self {
        Self { rest, ..Self::default() }
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.binary.len().is_multiple_of(4) {
            self.binary.push(0);
        }
        self.views.push(json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() }));
        self.binary.extend(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, mut accessor: Value, bytes: &[u8]) -> usize {
        accessor["bufferView"] = self.view(bytes).into();
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let accessor = json!({ "componentType": 5126, "type": kind, "count": values.len() / width });
        self.accessor(accessor, &bytes)
    }

    fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor(json!({ "componentType": 5123, "type": "SCALAR", "count": values.len() }), &bytes)
    }

    fn document(&self) -> Value {
        let mut document = self.rest.clone();
        document["asset"] = json!({ "version": "2.0" });
        document["accessors"] = self.accessors.clone().into();
        document["bufferViews"] = self.views.clone().into();
        document["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        document
    }

    fn glb(&self) -> Vec<u8> {
        glb(&self.document().to_string(), &self.binary)
    }

    fn load(&self) -> Result<Scene, SceneError> {
        load("m.glb", self.glb())
    }
}

fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let word = |value: usize| (value as u32).to_le_bytes();
    let length = 28 + json.len() + binary.len();
    [b"glTF", &word(2)[..], &word(length), &word(json.len()), b"JSON", &json, &word(binary.len()), b"BIN\0", &binary]
        .concat()
}

const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
const FOUR: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];

/// One triangle with a material.
fn with_material(material: Value) -> Gltf {
    let mut gltf = Gltf::new(json!({ "nodes": [{ "mesh": 0 }], "materials": [material] }));
    let position = gltf.floats("VEC3", &TRIANGLE);
    let uv = gltf.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    gltf.rest["meshes"] = json!([{ "primitives": [
        { "attributes": { "POSITION": position, "TEXCOORD_0": uv }, "material": 0 }
    ] }]);
    gltf
}

#[test]
fn strips_fans_and_sparse_and_quantised_accessors_are_triangles() {
    let mut gltf = Gltf::new(json!({ "nodes": [{ "mesh": 0 }], "extensionsRequired": ["KHR_mesh_quantization"] }));
    let position = gltf.floats("VEC3", &FOUR);
    let indices = gltf.indices(&[3, 2, 1, 0]);
    // Corner 3 of a zero-filled accessor, and another in shares of 255.
    let places = gltf.view(&[1, 2, 3]);
    let values: Vec<u8> = FOUR[3..].iter().flat_map(|value| value.to_le_bytes()).collect();
    let values = gltf.view(&values);
    gltf.accessors.push(json!({ "componentType": 5126, "type": "VEC3", "count": 4, "sparse": {
        "count": 3, "indices": { "bufferView": places, "componentType": 5121 }, "values": { "bufferView": values }
    } }));
    let sparse = gltf.accessors.len() - 1;
    let shares: Vec<u8> = FOUR.iter().map(|value| (255.0 * value) as u8).collect();
    let accessor = json!({ "componentType": 5121, "type": "VEC3", "count": 4, "normalized": true });
    let quantised = gltf.accessor(accessor, &shares);
    let attributes = |accessor: usize| json!({ "POSITION": accessor });
    gltf.rest["meshes"] = json!([{ "primitives": [
        { "attributes": attributes(position), "mode": 5 },
        { "attributes": attributes(position), "mode": 6, "indices": indices },
        { "attributes": attributes(sparse), "mode": 5 },
        { "attributes": attributes(quantised), "mode": 5 },
        { "attributes": attributes(position), "mode": 1 },
    ] }]);
    let scene = gltf.load().unwrap();
    let points = FOUR.as_chunks::<3>().0.iter().map(|point| Vec3::from(*point).as_dvec3()).collect::<Vec<_>>();
    let strip = [[0, 1, 2], [1, 3, 2]];
    let expected = [strip, [[2, 1, 3], [1, 0, 3]], strip, strip].concat();
    let expected: Vec<_> = expected.into_iter().map(|triangle| triangle.map(|index: usize| points[index])).collect();
    assert_eq!(corners(&scene), expected);
    assert_warns(&scene, "points and lines have no surface");
}

#[test]
fn nodes_place_meshes_cameras_and_lights() {
    let mut gltf = Gltf::new(json!({
        "scene": 1,
        "scenes": [{ "nodes": [] }, { "nodes": [0], "name": "this" }],
        "nodes": [
            { "children": [1, 2, 3, 4, 5], "translation": [10, 0, 0], "rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2] },
            { "mesh": 0, "scale": [-1, 1, 1] },
            { "camera": 0, "name": "left" },
            { "camera": 1, "matrix": [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 3, 1] },
            { "extensions": { "KHR_lights_punctual": { "light": 0 } } },
            { "extensions": { "KHR_lights_punctual": { "light": 1 } } }
        ],
        "cameras": [
            { "type": "perspective", "perspective": { "yfov": 1.0, "aspectRatio": 2.0, "znear": 0.1 } },
            { "type": "orthographic", "name": "flat", "orthographic": { "xmag": 3, "ymag": 1.5, "znear": 0, "zfar": 1 } }
        ],
        "extensions": { "KHR_lights_punctual": { "lights": [
            { "type": "spot", "intensity": 4, "color": [1, 0.5, 0], "spot": { "outerConeAngle": 0.5 } },
            { "type": "directional" }
        ] } }
    }));
    let position = gltf.floats("VEC3", &TRIANGLE);
    gltf.rest["meshes"] = json!([{ "primitives": [{ "attributes": { "POSITION": position } }] }]);
    let folder = Folder::new().with("m.glb", gltf.glb());
    let scene = folder.load("m.glb").unwrap();
    // A quarter turn takes x to -z; the mirror image keeps its front.
    let [[a, b, c]] = corners(&scene)[..] else { panic!("one triangle") };
    assert!(close(a, dvec3(10.0, 0.0, 0.0)) && close(b, dvec3(10.0, 1.0, 0.0)) && close(c, dvec3(10.0, 0.0, 1.0)));
    let camera = scene.camera;
    assert!(close(camera.eye, dvec3(10.0, 0.0, 0.0)) && close((camera.target - camera.eye).normalize(), DVec3::NEG_X));
    assert!((camera.vfov - 1.0_f64.to_degrees()).abs() < 1e-9 && camera.orthographic.is_none());
    assert_eq!((scene.settings.width, scene.settings.height), (1024, 512));
    assert_warns(&scene, "scene `this` is shown, of 2");
    assert_warns(&scene, "the first of 2 cameras is taken; --camera NAME");
    let [Light::Spot { position, direction, intensity, angles, falloff }, Light::Directional { irradiance, .. }] =
        scene.lights[..]
    else {
        panic!("{:?}", scene.lights)
    };
    assert!(close(position, dvec3(10.0, 0.0, 0.0)) && close(direction, DVec3::NEG_X));
    assert_eq!((intensity, falloff), (Vec3::new(4.0, 2.0, 0.0), Falloff::SquaredCosine));
    assert!(angles[0] == 0.0 && (angles[1] - 0.5_f64.to_degrees()).abs() < 1e-9);
    assert_eq!(irradiance, Vec3::ONE);

    let with = |camera: &str| {
        let options = LoadOptions { camera: Some(camera.to_owned()), ..LoadOptions::default() };
        Scene::load_with(&folder.path("m.glb"), &options)
    };
    let flat = with("flat").unwrap().camera;
    assert!(close(flat.eye, dvec3(13.0, 0.0, 0.0)) && flat.orthographic == Some(3.0));
    assert_eq!(with("left").unwrap().camera, camera);
    let error = with("none").unwrap_err().to_string();
    assert!(error.ends_with("m.glb: no camera `none`; take `left` or `flat`"), "{error}");

    // In a scene file its meshes are placed, and no more.
    let toml = "[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nvfov = 40\n[environment]\nradiance = [1, 1, 1]\n\
        [[mesh]]\nfile = \"m.glb\"\ntranslate = [0, 7, 0]\n[[mesh]]\nfile = \"m.glb\"\n[material.default]\nKd = 0.25\n";
    let placed = folder.with("s.toml", toml).load("s.toml").unwrap();
    assert!(close(corners(&placed)[0][1], dvec3(10.0, 8.0, 0.0)) && placed.mesh.triangles.len() == 2);
    assert!(placed.lights.is_empty() && placed.camera.vfov == 40.0);
    assert_eq!(placed.materials[0].diffuse, Vec3::splat(0.25));
    assert_warns(&placed, "its 2 cameras and 2 lights are left out");
}

#[test]
fn instances_on_the_gpu_are_instances() {
    let mut gltf = Gltf::new(json!({}));
    let position = gltf.floats("VEC3", &TRIANGLE);
    let translation = gltf.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 0.0, 5.0]);
    let accessor = json!({ "componentType": 5120, "type": "VEC4", "count": 2, "normalized": true });
    let rotation = gltf.accessor(accessor, &[0, 0, 0, 127, 0, 0, 127, 0]);
    gltf.rest["nodes"] = json!([{ "mesh": 0, "extensions": { "EXT_mesh_gpu_instancing": {
        "attributes": { "TRANSLATION": translation, "ROTATION": rotation }
    } } }]);
    gltf.rest["meshes"] = json!([{ "primitives": [{ "attributes": { "POSITION": position } }] }]);
    let scene = gltf.load().unwrap();
    assert_eq!(scene.mesh.triangles.len(), 2);
    assert!(close(corners(&scene)[1][1], dvec3(-1.0, 0.0, 5.0)));
}

#[test]
fn skins_and_targets_rest() {
    let mut gltf = Gltf::new(json!({
        "nodes": [{ "mesh": 0, "skin": 0, "translation": [100, 0, 0] }, { "translation": [0, 4, 0] }],
        "animations": [{ "channels": [], "samplers": [] }]
    }));
    let position = gltf.floats("VEC3", &TRIANGLE);
    let target = gltf.floats("VEC3", &[0.0, 0.0, 2.0, 0.0, 0.0, 2.0, 0.0, 0.0, 2.0]);
    let joints = gltf.accessor(json!({ "componentType": 5121, "type": "VEC4", "count": 3 }), &[0; 12]);
    let weights = gltf.accessor(
        json!({ "componentType": 5121, "type": "VEC4", "count": 3, "normalized": true }),
        &[255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0],
    );
    let mut bind = [0.0; 16];
    for place in [0, 5, 10, 15] {
        bind[place] = 1.0;
    }
    bind[13] = -1.0;
    let bind = gltf.floats("MAT4", &bind);
    gltf.rest["skins"] = json!([{ "joints": [1], "inverseBindMatrices": bind }]);
    gltf.rest["meshes"] = json!([{ "weights": [0.5], "primitives": [{
        "attributes": { "POSITION": position, "JOINTS_0": joints, "WEIGHTS_0": weights },
        "targets": [{ "POSITION": target }]
    }] }]);
    let scene = gltf.load().unwrap();
    assert!(close(corners(&scene)[0][1], dvec3(1.0, 3.0, 1.0)), "{:?}", corners(&scene));
    for phrase in ["skins are shown as their joints rest", "morph targets", "animations are not shown"] {
        assert_warns(&scene, phrase);
    }
}

#[test]
fn materials_are_those_of_metal_and_roughness() {
    let scene = with_material(json!({
        "name": "paint",
        "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.25, 1, 1], "metallicFactor": 0.5, "roughnessFactor": 0.5 },
        "emissiveFactor": [0, 1, 0],
        "extensions": {
            "KHR_materials_emissive_strength": { "emissiveStrength": 8 },
            "KHR_materials_ior": { "ior": 1.4 },
            "KHR_materials_specular": { "specularFactor": 0.5 },
            "KHR_materials_clearcoat": { "clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.5 },
            "KHR_materials_sheen": {}
        }
    }));
    let mut gltf = scene;
    gltf.rest["extensionsUsed"] = json!(["KHR_materials_ior", "KHR_materials_sheen"]);
    let scene = gltf.load().unwrap();
    let material = &scene.materials[0];
    assert_eq!((&*material.name, material.surface), ("paint", Surface::MetalRough));
    assert_eq!((material.diffuse, material.specular), (Vec3::new(0.5, 0.25, 1.0), Vec3::splat(0.5)));
    assert_eq!((material.metalness, material.roughness, material.ior), (0.5, Vec2::splat(0.25), 1.4));
    assert_eq!((material.coat, material.coat_roughness), (0.75, 0.25));
    assert_eq!((material.emission, material.is_pure_emitter), (Vec3::new(0.0, 8.0, 0.0), false));
    assert_warns(&scene, "these extensions are not shown: KHR_materials_sheen");
}

#[test]
fn glass_is_a_share_of_its_material() {
    let glass = |transmission: Value, rest: Value| {
        let mut material =
            json!({ "name": "m", "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0 } });
        material["extensions"] = json!({ "KHR_materials_transmission": transmission });
        for (key, value) in rest.as_object().unwrap() {
            material["extensions"][key] = value.clone();
        }
        with_material(material).load().unwrap().materials
    };
    let whole = glass(json!({ "transmissionFactor": 1 }), json!({}));
    assert_eq!(whole[0].surface, Surface::ThinDielectric);
    let volume = json!({ "KHR_materials_volume": { "thicknessFactor": 1 }, "KHR_materials_ior": { "ior": 1.33 } });
    let solid = glass(json!({ "transmissionFactor": 1 }), volume);
    assert_eq!((solid[0].surface, solid[0].ior), (Surface::Dielectric, 1.33));
    let mixed = glass(json!({ "transmissionFactor": 0.25 }), json!({}));
    let Surface::Blend(first, second) = mixed[0].surface else { panic!("{:?}", mixed[0].surface) };
    assert_eq!(mixed[0].weight, 0.25);
    assert_eq!(mixed[first as usize].surface, Surface::ThinDielectric);
    assert_eq!(mixed[second as usize].surface, Surface::MetalRough);
}

#[test]
fn alpha_lets_light_through() {
    let material = |mode: &str, cutoff: f64| {
        let mut gltf = with_material(json!({ "alphaMode": mode, "alphaCutoff": cutoff, "pbrMetallicRoughness": {
            "baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": { "index": 0 }
        } }));
        let view = gltf.view(&png([255, 255, 255, 204]));
        gltf.rest["textures"] = json!([{ "source": 0 }]);
        gltf.rest["images"] = json!([{ "bufferView": view, "mimeType": "image/png" }]);
        gltf.load().unwrap()
    };
    for (mode, cutoff, weight) in [("BLEND", 0.5, 0.4), ("MASK", 0.5, 0.0), ("MASK", 0.3, 1.0)] {
        let scene = material(mode, cutoff);
        let blend = &scene.materials[scene.mesh.triangles[0].material as usize];
        let Surface::Blend(opaque, nothing) = blend.surface else { panic!("{:?}", blend.surface) };
        assert_eq!(scene.materials[opaque as usize].surface, Surface::MetalRough);
        assert_eq!(scene.materials[nothing as usize].surface, Surface::Nothing);
        let texture = blend.texture(Parameter::Weight).expect("an image gives its weight");
        let texel = scene.textures[texture as usize].texels[0][0].to_f32();
        assert!((texel - weight).abs() < 1e-3, "{mode} {cutoff}: {texel}");
    }
    let scene = material("OPAQUE", 0.5);
    assert_eq!(scene.materials[scene.mesh.triangles[0].material as usize].surface, Surface::MetalRough);
}

#[test]
fn images_lie_by_flipped_and_transformed_coordinates() {
    let mut gltf = with_material(json!({ "pbrMetallicRoughness": {
        "baseColorTexture": { "index": 0, "extensions": { "KHR_texture_transform": {
            "offset": [0.25, 0.5], "rotation": 0.3, "scale": [2, 3]
        } } },
        "metallicRoughnessTexture": { "index": 1 },
        "roughnessFactor": 0.5,
    }, "normalTexture": { "index": 0, "texCoord": 1 } }));
    gltf.rest["textures"] = json!([{ "source": 0, "sampler": 0 }, { "source": 0 }]);
    gltf.rest["samplers"] = json!([{ "magFilter": 9728, "wrapS": 33071, "wrapT": 33648 }]);
    gltf.rest["images"] = json!([{ "uri": "my%20image.png" }]);
    let folder = Folder::new().with("m.glb", gltf.glb()).with("my image.png", png([255, 51, 102, 255]));
    let scene = folder.load("m.glb").unwrap();
    let uvs = scene.mesh.triangles[0].uvs.map(|index| scene.mesh.uvs[index as usize]);
    assert_eq!(uvs, [vec2(0.0, 1.0), vec2(1.0, 1.0), vec2(0.0, 0.0)]);
    let texture = |parameter| scene.materials[0].texture(parameter).map(|index| &scene.textures[index as usize]);
    let colour = texture(Parameter::Diffuse).expect("an image gives its colour");
    assert_eq!((colour.lookup.wrap, colour.lookup.is_smooth), (Wrap::Clamp, false));
    // The formula of KHR_texture_transform, where v grows downwards.
    let (sine, cosine) = 0.3_f32.sin_cos();
    for [u, v] in [[0.0_f32, 0.0], [1.0, 0.0], [0.3, 0.9]] {
        let (u2, v2) = (2.0 * u, 3.0 * v);
        let expected = vec2(cosine * u2 + sine * v2 + 0.25, 1.0 - (-sine * u2 + cosine * v2 + 0.5));
        let found = colour.lookup.transform.transform_point2(vec2(u, 1.0 - v));
        assert!(found.distance(expected) < 1e-5, "{found} {expected}");
    }
    let value = |parameter| texture(parameter).expect("an image gives it").texels[0][0].to_f32();
    assert!((value(Parameter::Metalness) - 0.4).abs() < 1e-3);
    assert!((value(Parameter::Roughness) - 0.01).abs() < 1e-4);
    assert!(texture(Parameter::Normal).is_none());
    assert_warns(&scene, "several sets of texture coordinates");
    assert_warns(&scene, "wraps differently along u and v");
}

#[test]
fn buffers_are_files_and_data_uris() {
    let mut gltf = with_material(json!({ "extensions": { "KHR_materials_unlit": {} } }));
    gltf.rest["extensionsRequired"] = json!(["KHR_materials_unlit"]);
    let mut document = gltf.document();
    document["buffers"][0]["uri"] = "sub/m.bin".into();
    let scene =
        Folder::new().with("m.gltf", document.to_string()).with("sub/m.bin", &gltf.binary).load("m.gltf").unwrap();
    assert!(scene.materials[0].only_emits() && scene.materials[0].emission == Vec3::ONE);
    let hexadecimal: String = gltf.binary.iter().map(|byte| format!("%{byte:02x}")).collect();
    document["buffers"][0]["uri"] = format!("data:application/octet-stream,{hexadecimal}").into();
    assert_eq!(corners(&load("m.gltf", document.to_string()).unwrap()), corners(&scene));
}

#[test]
fn bad_gltf_files_are_refused_in_one_line() {
    let good = with_material(json!({}));
    let changed = |path: &str, value: Value| {
        let mut document = good.document();
        *document.pointer_mut(path).expect(path) = value;
        glb(&document.to_string(), &good.binary)
    };
    let with = |key: &str, value: Value| {
        let mut document = good.document();
        document[key] = value;
        glb(&document.to_string(), &good.binary)
    };
    let short = good.glb()[..100].to_vec();
    let cases = [
        (b"glTF".to_vec(), "the file ends early"),
        (short, "the file ends early"),
        ([b"glTF", &1_u32.to_le_bytes()[..], &[0; 12]].concat(), "binary glTF of version 1"),
        ([b"glTF", &2_u32.to_le_bytes()[..], &[0; 4]].concat(), "no JSON in it"),
        (b"<html>".to_vec(), "not a glTF file but a web page"),
        (b"{".to_vec(), "m.glb:1: EOF while parsing"),
        (b"{\n\"asset\": 3}".to_vec(), "m.glb:2: invalid type"),
        (b"{}".to_vec(), "missing field `asset`"),
        ([b"{\"a\":".to_vec(), vec![b'['; 100_000]].concat(), "EOF while parsing"),
        (changed("/asset/version", "1.0".into()), "glTF 1.0; convert it"),
        (with("extensionsRequired", json!(["KHR_draco_mesh_compression"])), "npx @gltf-transform/cli copy"),
        (with("extensionsRequired", json!(["EXT_other"])), "it requires EXT_other, which is not read"),
        (with("scene", 3.into()), "no scene 3"),
        (with("scenes", json!([{ "nodes": [7] }])), "no node 7"),
        (with("nodes", json!([{ "mesh": 5 }])), "no mesh 5"),
        (with("nodes", json!([{ "children": [1] }, { "children": [0], "mesh": 0 }])), "among its own descendants"),
        (with("nodes", json!([{ "children": [0], "mesh": 0 }])), "among its own descendants"),
        (with("nodes", json!([{ "children": [2] }, { "children": [2] }, { "mesh": 0 }])), "node 2 has two parents"),
        (with("nodes", json!([{ "mesh": 0, "rotation": [0, 0, 0, 0] }])), "no quaternion"),
        (with("nodes", json!([{ "mesh": 0, "scale": [1e300, 1e300, 1e300] }])), "lands beyond"),
        (with("nodes", json!([{ "mesh": 0, "camera": 0 }])), "no camera 0"),
        (with("nodes", json!([{ "mesh": 0, "skin": 0 }])), "no skin 0"),
        (with("nodes", json!([{ "mesh": 0, "extensions": { "KHR_lights_punctual": { "light": 2 } } }])), "no light 2"),
        (with("nodes", json!([])), "no triangles in its scene"),
        (changed("/meshes/0/primitives/0/material", 4.into()), "no material 4"),
        (changed("/meshes/0/primitives/0/attributes/POSITION", 9.into()), "no accessor 9"),
        (
            changed("/meshes/0/primitives/0/attributes/POSITION", 1.into()),
            "accessor 1 is of VEC2, where VEC3 is needed",
        ),
        (changed("/accessors/0/componentType", 7.into()), "unknown component type 7"),
        (changed("/accessors/0/count", 4.into()), "accessor 0 reaches beyond buffer view 0"),
        (changed("/accessors/0/count", u64::MAX.into()), "accessor 0 reaches beyond buffer view 0"),
        (changed("/accessors/0/count", 2.into()), "accessor 1 has 3 elements for 2 vertices"),
        (changed("/accessors/0/bufferView", 9.into()), "no buffer view 9"),
        (changed("/accessors/0/bufferView", Value::Null), "no triangle has an area"),
        (
            changed("/accessors/0", json!({ "componentType": 5126, "type": "VEC3", "count": 4_000_000_000_u64 })),
            "and no bytes",
        ),
        (changed("/bufferViews/0/byteOffset", u64::MAX.into()), "buffer view 0 reaches beyond"),
        (changed("/bufferViews/0/byteLength", 4000.into()), "buffer view 0 reaches beyond"),
        (changed("/buffers/0", json!({ "byteLength": 99, "uri": "no.bin" })), "cannot read"),
        (changed("/buffers/0", json!({ "byteLength": 99, "uri": "http://a/b" })), "is no file beside it"),
        (changed("/buffers/0", json!({ "byteLength": 99, "uri": "data:;base64,!!" })), "bad base64"),
        (changed("/buffers/0", json!({ "byteLength": 99, "uri": "../no.bin" })), "lies outside of the scene's folder"),
    ];
    for (bytes, expected) in cases {
        let error = load("m.glb", &bytes).expect_err(expected).to_string();
        assert!(error.contains(expected) && !error.contains('\n'), "{expected}: {error}");
    }
    let options = LoadOptions { lenient: true, ..LoadOptions::default() };
    let folder = Folder::new().with("m.glb", with("extensionsRequired", json!(["EXT_other"])));
    assert!(Scene::load_with(&folder.path("m.glb"), &options).is_ok());
}

#[test]
fn torn_gltf_files_never_panic() {
    let bytes = with_material(json!({ "pbrMetallicRoughness": {} })).glb();
    for end in 0..bytes.len() {
        if let Err(error) = load("m.glb", &bytes[..end]) {
            assert!(!error.to_string().contains('\n'), "{error}");
        }
    }
    for at in 0..bytes.len() {
        for flip in [1, 0x80] {
            let mut bytes = bytes.clone();
            bytes[at] ^= flip;
            if let Err(error) = load("m.glb", &bytes) {
                assert!(!error.to_string().contains('\n'), "{error}");
            }
        }
    }
}

#[test]
fn scales_of_normal_maps_keep_directions() {
    for (scale, expected) in [(1.0, [0.6, 0.0, 0.8]), (0.5, [0.3, 0.0, 0.8]), (2.0, [0.6, 0.0, 0.4])] {
        let mut gltf = with_material(json!({ "normalTexture": { "index": 0, "scale": scale } }));
        let view = gltf.view(&png([204, 128, 230, 255]));
        gltf.rest["textures"] = json!([{ "source": 0 }]);
        gltf.rest["images"] = json!([{ "bufferView": view }]);
        let scene = gltf.load().unwrap();
        let texture = scene.materials[0].texture(Parameter::Normal).expect("an image turns its normals");
        let [x, y, z, _] = scene.textures[texture as usize].texels[0].map(|value| 2.0 * value.to_f32() - 1.0);
        assert!(Vec3::new(x, y, z).distance(Vec3::from(expected)) < 0.01, "{scale}: {x} {y} {z}");
    }
}

// Files

#[test]
fn converted_scenes_are_the_same() {
    let mtl = "newmtl paint\nKd 0.1 0.2 0.3\nKs 0.5\nNs 12.5\nnewmtl my glass\nillum 7\nNi 1.52\nTf 0.9 1 1\nnewmtl lamp\n\
        Ke 7 6.5 6\nnewmtl tile\nmap_Kd -s 2 3 1 -o 0.25 0 0 t.png\nnewmtl mirror\nillum 3\nKs 0.7\n";
    let obj = "mtllib m.mtl\nv 0.1 0 0\nv 1 0.3333333333333333 0\nv 0 1 1e-9\nv 1 1 7\nvn 0 0.6 0.8\nvt 0.1 0.2\nvt 0.3 1\nvt 1 0\n\
        usemtl paint\nf 1//1 2//1 3//1\nf 2 4 3\nusemtl my glass\nf 1 2 4\nusemtl lamp\nf 4 2 1\nusemtl tile\n\
        f 1/1/1 2/2/1 4/3/1\nusemtl mirror\nf 3 2 1\n";
    let toml = "[camera]\neye = [0.1, 0, 5]\ntarget = [0, 0.3, 0]\nvfov = 33.3\naperture = 0.01\nfocus = 4\n[film]\nwidth = 20\n\
        [render]\nintegrator = \"mis\"\nmax_bounces = -1\nroulette = 0.25\nsampler = \"independent\"\n\
        [environment]\nradiance = [0.1, 0.2, 0.3]\n[[mesh]]\nfile = \"m.obj\"\ntranslate = [0.1, 0.2, 0.3]\n";
    let folder =
        Folder::new().with("s.toml", toml).with("m.obj", obj).with("m.mtl", mtl).with("t.png", png([9, 99, 199, 255]));
    let scene = folder.load("s.toml").unwrap();
    for (format, name) in [(MeshFormat::Obj, "o.toml"), (MeshFormat::Ply, "p.toml")] {
        let files = SceneFiles::new(&scene, &folder.path(name), format);
        assert!(files.lost.is_empty(), "{:?}", files.lost);
        files.write().unwrap();
        assert!(files.paths().iter().all(|path| path.is_file()));
        let again = folder.load(name).unwrap();
        assert!(again.warnings.is_empty(), "{:?}", again.warnings);
        assert_eq!((again.camera, again.settings), (scene.camera, scene.settings));
        assert_eq!(corners(&again), corners(&scene));
        for (one, other) in scene.mesh.triangles.iter().zip(&again.mesh.triangles) {
            let [a, b] =
                [(&scene, one), (&again, other)].map(|(scene, triangle)| &scene.materials[triangle.material as usize]);
            let same = raywave::scene::Material { name: a.name.clone(), textures: a.textures, ..b.clone() };
            assert_eq!(*a, same);
            let texture = |scene: &Scene, material: &raywave::scene::Material, triangle: &raywave::scene::Triangle| {
                material.texture(Parameter::Diffuse).map(|index| {
                    let texture = &scene.textures[index as usize];
                    let uvs = triangle.uvs.map(|uv| scene.mesh.uvs[uv as usize]);
                    (texture.texels[0], uvs.map(|uv| texture.lookup.transform.transform_point2(uv)))
                })
            };
            assert_eq!(texture(&scene, a, one), texture(&again, b, other));
            assert_eq!(one.normals[0] == NONE, other.normals[0] == NONE);
        }
    }
}

#[test]
fn what_a_scene_file_cannot_say_is_listed() {
    let mut gltf = with_material(json!({ "name": "iron", "emissiveFactor": [1, 0, 0] }));
    gltf.rest["nodes"] = json!([{ "mesh": 0 }, { "extensions": { "KHR_lights_punctual": { "light": 0 } } }]);
    gltf.rest["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    let folder = Folder::new().with("m.glb", gltf.glb());
    let scene = folder.load("m.glb").unwrap();
    let files = SceneFiles::new(&scene, &folder.path("o.toml"), MeshFormat::Ply);
    assert_eq!(
        files.lost,
        ["the kind of surface of `o-iron`", "what reflects of `o-iron`", "1 lights that are no surfaces"]
    );
    files.write().unwrap();
    assert_eq!(folder.load("o.toml").unwrap().materials[0].emission, Vec3::X);
    let nowhere = SceneFiles::new(&scene, &folder.path("no/where.toml"), MeshFormat::Obj).write();
    assert!(nowhere.is_err_and(|(path, _)| path.ends_with("no/where.obj")));
}

#[test]
fn names_do_not_reach_outside_of_the_folder() {
    let camera = "[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nvfov = 40\n";
    let obj = "mtllib ../materials/m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n";
    let folder = Folder::new()
        .with("scene/s.toml", format!("{camera}[[mesh]]\nfile = \"meshes/m.obj\"\n"))
        .with("scene/meshes/m.obj", obj)
        .with("scene/materials/m.mtl", "newmtl a\nKd 0.1\nKe 0\nmap_Kd ../../secret.png\n")
        .with("scene/outside.toml", format!("{camera}[[mesh]]\nfile = \"meshes/../../o.obj\"\n"))
        .with("o.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        .with("secret.png", png([255, 0, 0, 255]));
    let scene = folder.load("scene/s.toml").unwrap();
    assert_eq!(scene.materials[0].diffuse, Vec3::splat(0.1));
    assert_warns(&scene, "secret.png` lies outside of the scene's folder; move it there, or pass --allow-outside");
    // By itself the mesh has a folder of its own.
    assert_warns(&folder.load("scene/meshes/m.obj").unwrap(), "m.mtl` lies outside of the scene's folder");
    let error = folder.load("scene/outside.toml").unwrap_err().to_string();
    assert!(error.contains("outside.toml:6: ") && error.contains("lies outside"), "{error}");
    let absolute = format!("{camera}[[mesh]]\nfile = {:?}\n", folder.path("o.obj"));
    let folder = folder.with("scene/absolute.toml", absolute);
    assert!(folder.load("scene/absolute.toml").unwrap_err().to_string().contains("lies outside"));
    let options = LoadOptions { allow_outside: true, ..LoadOptions::default() };
    for name in ["scene/outside.toml", "scene/absolute.toml"] {
        assert!(Scene::load_with(&folder.path(name), &options).is_ok(), "{name}");
    }
    let scene = Scene::load_with(&folder.path("scene/s.toml"), &options).unwrap();
    assert!(scene.materials[0].texture(Parameter::Diffuse).is_some());
}

#[test]
fn up_turns_the_view_of_a_bare_mesh() {
    let folder = Folder::new().with("m.obj", "v -1 -1 0\nv 1 -1 0\nv 0 1 2\nf 1 2 3\n");
    let with = |up| Scene::load_with(&folder.path("m.obj"), &LoadOptions { up, ..LoadOptions::default() });
    let [plain, y, z] = [None, Some([0.0, 2.0, 0.0]), Some([0.0, 0.0, 1.0])].map(|up| with(up).unwrap().camera);
    assert_eq!(plain, y);
    assert_eq!(z.up, DVec3::Z);
    let towards = (z.eye - z.target).normalize();
    assert!(close(towards, dvec3(0.0, -1.0, 0.25).normalize()), "{towards}");
    assert!(with(Some([0.0; 3])).unwrap_err().to_string().contains("up has no direction"));
    let options = LoadOptions { camera: Some("a".to_owned()), ..LoadOptions::default() };
    let error = Scene::load_with(&folder.path("m.obj"), &options).unwrap_err().to_string();
    assert!(error.contains("its cameras have no names"), "{error}");
    assert_ne!(NONE, 0);
}
