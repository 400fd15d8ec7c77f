//! Scenes of Mitsuba 3: what their elements mean, and what is said about those that break the format. Random and mutated
//! files must give an error or a scene, never a panic.

use std::{fs, path::Path};

use glam::{DMat3, DVec3, Vec2, Vec3, dvec3, vec3};
use proptest::prelude::*;
use raywave::scene::{Environment, Falloff, Light, LoadOptions, Material, Parameter, Scene, SceneError, Surface, Wrap};
use raywave::settings::{Integrator, RouletteMode, Sampler};
use tempfile::TempDir;

const RECTANGLE: &str = "<shape type='rectangle'/>";

fn folder(files: &[(&str, &[u8])]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, contents) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, contents).unwrap();
    }
    folder
}

fn load_with(files: &[(&str, &[u8])], options: &LoadOptions) -> Result<Scene, SceneError> {
    Scene::load_with(&folder(files).path().join("s.xml"), options)
}

fn read(body: &str) -> Result<Scene, SceneError> {
    let text = format!("<scene version='3.0.0'>\n{body}\n</scene>");
    load_with(&[("s.xml", text.as_bytes())], &LoadOptions::default())
}

fn scene(body: &str) -> Scene {
    read(body).unwrap_or_else(|error| panic!("{error}"))
}

/// Everything after the name of the file.
fn complaint(body: &str) -> String {
    let error = read(body).expect_err(body).to_string();
    assert!(!error.contains('\n'), "{error}");
    let (_, rest) = error.split_once("s.xml:").unwrap_or_else(|| panic!("{error}"));
    rest.to_owned()
}

/// The material of a rectangle with a BSDF, and the scene.
fn shown(bsdf: &str) -> (Material, Scene) {
    let scene = scene(&format!("<shape type='rectangle'>{bsdf}</shape>"));
    (scene.materials[scene.mesh.triangles[0].material as usize].clone(), scene)
}

/// The material of the front of a BSDF that only reflects.
fn front(bsdf: &str) -> Material {
    let (outer, scene) = shown(bsdf);
    let Surface::Sides { front, back } = outer.surface else { panic!("{:?}", outer.surface) };
    let back = &scene.materials[back as usize];
    assert!(back.surface == Surface::Glossy && back.diffuse == Vec3::ZERO && !back.is_emitter(), "the back is black");
    scene.materials[front as usize].clone()
}

fn warns(scene: &Scene, phrase: &str) -> bool {
    scene.warnings.iter().any(|warning| warning.contains(phrase))
}

// The file

#[test]
fn parameters_files_and_references_are_put_together() {
    let outer = b"<scene version='3.0.0'><default name='r' value='0.25'/><path value='parts'/>\n\
        <include filename='shapes.xml'/><bsdf type='diffuse' id='late'><rgb name='reflectance' value='$r'/></bsdf></scene>";
    let inner = b"<scene version='2.1.0'><default name='r' value='1'/><shape type='obj'>\
        <string name='filename' value='m.obj'/><ref id='late'/></shape></scene>";
    let mesh = b"mtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0.25\nf 1/1 2/1 3/1\n";
    let files: &[(&str, &[u8])] = &[("s.xml", outer), ("parts/shapes.xml", inner), ("parts/m.obj", mesh)];
    let scene = load_with(files, &LoadOptions::default()).unwrap();
    assert!(scene.materials.iter().any(|material| material.diffuse == Vec3::splat(0.25)));
    assert!(!warns(&scene, "MTL"), "Mitsuba knows no MTL: {:?}", scene.warnings);
    assert!(scene.mesh.triangles[0].normals[0] != raywave::scene::NONE, "a mesh without normals is smooth");
}

#[test]
fn what_breaks_the_format_is_told_with_its_line() {
    for (body, line, phrase) in [
        ("<shape type='rectangle'>\n<float name='x' value='1,5'/></shape>", 3, "`1,5` is not a number"),
        ("<float name='x' value='nan'/>", 2, "not finite"),
        ("<float value='1'/>", 2, "no name"),
        ("<float name='x'/>", 2, "no value"),
        ("<shape/>", 2, "no type"),
        ("<thing/>", 2, "no element <thing>"),
        ("<shape type='rectangle'><ref id='x'/></shape>", 2, "nothing has the id `x`"),
        ("<bsdf type='null' id='a'/>\n<bsdf type='null' id='a'/>", 3, "the id `a` is taken"),
        ("<float name='x' value='$y'/>", 2, "nothing gives $y"),
        ("<include filename='none.xml'/>", 2, "cannot read"),
        ("<include filename='s.xml'/>", 2, "without end"),
        ("<float name='x' value='1'>", 3, "correct the XML"),
        ("<shape type='rectangle'><transform name='to_world'><turn/></transform></shape>", 2, "no step <turn>"),
        ("<shape type='rectangle'><transform name='to_world'><rotate angle='3'/></transform></shape>", 2, "axis"),
        (
            "<shape type='rectangle'><transform name='to_world'><matrix value='1 2'/></transform></shape>",
            2,
            "2 numbers",
        ),
        ("<shape type='sphere'><float name='radius' value='0'/></shape>", 2, "radius"),
        ("<shape type='sphere'><string name='radius' value='a'/></shape>", 2, "is a string; give a float"),
        ("<shape type='obj'/>", 2, "names no file"),
        ("<shape type='obj'><string name='filename' value='no.obj'/></shape>", 2, "cannot read"),
        ("<shape type='serialized'><string name='filename' value='s.xml'/></shape>", 0, "not a serialized mesh"),
        ("<shape type='instance'/>", 2, "instance of nothing"),
        (
            "<emitter type='constant'/>\n<emitter type='constant'/>\n<shape type='cube'/>",
            3,
            "second light from infinity",
        ),
        ("<sensor type='perspective'><float name='fov' value='180'/></sensor>", 2, "outside (0, 180)"),
        (
            "<sensor type='perspective'><film type='hdrfilm'><integer name='width' value='0'/></film></sensor>",
            2,
            "width",
        ),
    ] {
        let error = complaint(body);
        let starts = if line == 0 { error.starts_with(' ') } else { error.starts_with(&format!("{line}: ")) };
        assert!(starts && error.contains(phrase), "{body}: {error}");
    }
    for (bsdf, phrase) in [
        ("<bsdf type='diffuse'><rgb name='reflectance' value='1.5'/></bsdf>", "outside [0, 1]"),
        ("<bsdf type='diffuse'><rgb name='reflectance' value='1 2'/></bsdf>", "2 numbers"),
        ("<bsdf type='diffuse'><string name='reflectance' value='1'/></bsdf>", "no colour"),
        ("<bsdf type='dielectric'><string name='int_ior' value='mud'/></bsdf>", "no `mud`"),
        ("<bsdf type='conductor'><string name='material' value='Fe'/></bsdf>", "no metal `Fe`"),
        ("<bsdf type='twosided'/>", "0 BSDFs"),
        ("<bsdf type='roughconductor'><float name='alpha_u' value='0.1'/></bsdf>", "alpha_u and alpha_v"),
        ("<bsdf type='twosided' id='a'><ref id='a'/></bsdf>", "deep in each other"),
        ("<bsdf type='diffuse'><spectrum name='reflectance' value='500:1 400:2'/></bsdf>", "do not ascend"),
    ] {
        let error = complaint(&format!("<shape type='rectangle'>{bsdf}</shape>"));
        assert!(error.starts_with("2: ") && error.contains(phrase), "{bsdf}: {error}");
    }
    let old = b"<scene version='0.6.0'/>";
    let error = load_with(&[("s.xml", old)], &LoadOptions::default()).expect_err("old").to_string();
    assert!(error.contains("s.xml:1: version 0.6.0"), "{error}");
}

#[test]
fn plugins_that_are_not_supported_are_told_all_at_once_or_left_out() {
    let body = "<shape type='rectangle'><bsdf type='hair'/></shape>\n<shape type='bsplinecurve'/>\n\
                <shape type='bsplinecurve'/>\n<emitter type='sunsky'/>";
    let error = complaint(body);
    assert!(
        error.starts_with("2: not supported: bsdf `hair` (line 2); shape `bsplinecurve` (line 3, line 4); "),
        "{error}"
    );
    assert!(error.contains("emitter `sunsky` (line 5)") && error.contains("--lenient"), "{error}");
    let text = format!("<scene version='3.0.0'>\n{body}</scene>");
    let scene = load_with(&[("s.xml", text.as_bytes())], &LoadOptions { lenient: true, ..Default::default() }).unwrap();
    assert_eq!(scene.mesh.triangles.len(), 2);
    assert!(warns(&scene, "left out (the first of 4)"), "{:?}", scene.warnings);
}

#[test]
fn a_shape_may_refer_to_an_emitter_of_the_scene() {
    let scene = scene(
        "<emitter type='area' id='lamp'><rgb name='radiance' value='1 2 3'/></emitter>\n\
         <shape type='rectangle'><ref id='lamp'/></shape>",
    );
    let lamp = &scene.materials[scene.mesh.triangles[0].material as usize];
    assert_eq!(lamp.emission, vec3(1.0, 2.0, 3.0));
    // One that nothing can refer to.
    let error = complaint(&format!("{RECTANGLE}<emitter type='area'/>"));
    assert!(error.contains("not supported: emitter `area`"), "{error}");
}

#[test]
fn what_nobody_reads_is_told() {
    let scene = scene("<shape type='rectangle'><float name='colour' value='1'/></shape>");
    assert!(warns(&scene, "s.xml:2: `colour` has no effect on shape `rectangle`"), "{:?}", scene.warnings);
}

// Shapes

#[test]
fn transforms_apply_in_their_order() {
    let place = |steps: &str| {
        let body = format!("<shape type='rectangle'><transform name='to_world'>{steps}</transform></shape>");
        scene(&body).mesh.positions[3]
    };
    assert!(place("<scale x='2'/><translate value='1 2 3'/>").abs_diff_eq(dvec3(3.0, 3.0, 3.0), 1e-12));
    assert!(place("<translate x='1'/><scale value='2'/>").abs_diff_eq(dvec3(4.0, 2.0, 0.0), 1e-12));
    assert!(place("<rotate z='2' angle='90'/>").abs_diff_eq(dvec3(-1.0, 1.0, 0.0), 1e-12));
    let matrix = "<matrix value='0 0 1 5  1 0 0 6  0 1 0 7  0 0 0 1'/>";
    assert!(place(matrix).abs_diff_eq(dvec3(5.0, 7.0, 8.0), 1e-12));
    // Looking along x with z up, y is to the left.
    let looking = "<lookat origin='0 0 0' target='1 0 0' up='0 0 1'/>";
    assert!(place(looking).abs_diff_eq(dvec3(0.0, 1.0, 1.0), 1e-12));
}

#[test]
fn fronts_stay_in_front_under_mirrors_and_turn_when_told() {
    let front = |shape: &str| {
        let scene = scene(shape);
        let [a, b, c] = scene.mesh.triangles[0].positions.map(|corner| scene.mesh.positions[corner as usize]);
        let normal = (b - a).cross(c - a).normalize();
        let smooth = scene.mesh.normals[scene.mesh.triangles[0].normals[0] as usize].as_dvec3();
        assert!(normal.dot(smooth) > 0.99, "{shape}: {normal} {smooth}");
        normal
    };
    assert!(front(RECTANGLE).abs_diff_eq(DVec3::Z, 1e-12));
    let mirrored = "<shape type='rectangle'><transform name='to_world'><scale x='-1'/></transform></shape>";
    assert!(front(mirrored).abs_diff_eq(DVec3::Z, 1e-12));
    let flipped = "<shape type='rectangle'><boolean name='flip_normals' value='true'/></shape>";
    assert!(front(flipped).abs_diff_eq(DVec3::NEG_Z, 1e-12));
}

#[test]
fn spheres_and_cylinders_are_where_they_say() {
    let ball = scene(
        "<shape type='sphere'><point name='center' x='1' y='2' z='3'/><float name='radius' value='0.5'/>\
         <transform name='to_world'><scale value='2'/></transform></shape>",
    );
    let (low, high) = ball.bounds();
    assert!(
        low.abs_diff_eq(dvec3(1.0, 3.0, 5.0), 1e-3) && high.abs_diff_eq(dvec3(3.0, 5.0, 7.0), 1e-3),
        "{low} {high}"
    );
    let pipe = scene("<shape type='cylinder'><point name='p0' value='0 0 1'/><point name='p1' value='4 0 1'/></shape>");
    let (low, high) = pipe.bounds();
    assert!(
        low.abs_diff_eq(dvec3(0.0, -1.0, 0.0), 1e-3) && high.abs_diff_eq(dvec3(4.0, 1.0, 2.0), 1e-3),
        "{low} {high}"
    );
}

#[test]
fn groups_are_seen_where_they_are_placed() {
    let scene = scene(
        "<shape type='shapegroup' id='g'><shape type='rectangle'><transform name='to_world'><translate x='1'/></transform>\
         </shape></shape><shape type='instance'><ref id='g'/><transform name='to_world'><scale value='3'/></transform></shape>\
         <shape type='instance'><ref id='g'/></shape>",
    );
    assert_eq!(scene.mesh.triangles.len(), 4);
    let (low, high) = scene.bounds();
    assert!(low.abs_diff_eq(dvec3(0.0, -3.0, 0.0), 1e-12) && high.abs_diff_eq(dvec3(6.0, 3.0, 0.0), 1e-12));
}

#[test]
fn ply_meshes_are_as_mitsuba_has_them() {
    let mesh = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float u\nproperty float v\nproperty float red\nproperty float green\nproperty float blue\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 0 0.25 1 0 0\n1 0 0 1 0.25 1 0 0\n0 1 0 0 0.75 1 0 0\n3 0 1 2\n";
    let scene = |more: &str| {
        let text = format!(
            "<scene version='3.0.0'><shape type='ply'><string name='filename' value='m.ply'/>{more}\
             <bsdf type='diffuse'><texture name='reflectance' type='checkerboard'/></bsdf>\
             <transform name='to_world'><translate x='1'/></transform></shape></scene>"
        );
        let files: &[(&str, &[u8])] = &[("s.xml", text.as_bytes()), ("m.ply", mesh)];
        load_with(files, &LoadOptions::default()).unwrap()
    };
    let corner = |scene: &Scene, corner: usize| scene.mesh.uvs[scene.mesh.triangles[0].uvs[corner] as usize];
    let plain = scene("");
    assert_eq!(plain.mesh.positions[0], DVec3::X);
    assert_eq!((corner(&plain, 0), corner(&plain, 2)), (Vec2::new(0.0, 0.25), Vec2::new(0.0, 0.75)));
    assert_ne!(plain.mesh.triangles[0].normals[0], raywave::scene::NONE);
    // In Mitsuba a texture shows colours of vertices, or nothing does.
    assert!(!warns(&plain, "colours"), "{:?}", plain.warnings);
    let turned = scene("<boolean name='flip_tex_coords' value='true'/><boolean name='face_normals' value='true'/>");
    assert_eq!(corner(&turned, 0), Vec2::new(0.0, 0.75));
    assert_eq!(turned.mesh.triangles[0].normals[0], raywave::scene::NONE);
}

// BSDFs and textures

#[test]
fn bsdfs_become_surfaces() {
    assert_eq!(front("").diffuse, Vec3::splat(0.5));
    assert_eq!(
        front("<bsdf type='diffuse'><rgb name='reflectance' value='0.1, 0.2 0.3'/></bsdf>").diffuse,
        vec3(0.1, 0.2, 0.3)
    );

    let (glass, _) = shown("<bsdf type='dielectric'/>");
    assert_eq!((glass.surface, glass.ior), (Surface::Dielectric, (1.5046_f64 / 1.000277) as f32));
    let (glass, _) =
        shown("<bsdf type='roughdielectric'><float name='alpha' value='0.2'/><float name='ext_ior' value='2'/></bsdf>");
    assert_eq!((glass.ior, glass.roughness, glass.is_beckmann), (1.5046 / 2.0, Vec2::splat(0.2), true));
    assert!(!glass.compensates);

    let gold = front(
        "<bsdf type='roughconductor'><string name='material' value='Au'/><float name='alpha_u' value='0.1'/>\
        <float name='alpha_v' value='0.3'/><string name='distribution' value='ggx'/></bsdf>",
    );
    assert_eq!((gold.surface, gold.roughness, gold.is_beckmann), (Surface::Conductor, Vec2::new(0.1, 0.3), false));
    assert!(gold.eta.x < 0.2 && gold.absorption.x > 3.9 && gold.specular == Vec3::ONE);
    let mirror = front("<bsdf type='conductor'/>");
    assert_eq!((mirror.eta, mirror.absorption), (Vec3::ZERO, Vec3::ONE));

    let plastic = front("<bsdf type='plastic'><boolean name='nonlinear' value='true'/></bsdf>");
    assert_eq!((plastic.surface, plastic.ior), (Surface::Plastic { nonlinear: true }, (1.49_f64 / 1.000277) as f32));
}

#[test]
fn bsdfs_nest() {
    let (outer, scene) = shown("<bsdf type='twosided'><bsdf type='diffuse'/></bsdf>");
    assert_eq!((outer.surface, scene.materials.len()), (Surface::Glossy, 1));

    let (outer, scene) = shown(
        "<bsdf type='twosided'><bsdf type='diffuse'><float name='reflectance' value='0.25'/></bsdf>\
         <bsdf type='diffuse'><float name='reflectance' value='0.75'/></bsdf></bsdf>",
    );
    let Surface::Sides { front, back } = outer.surface else { panic!("{:?}", outer.surface) };
    assert_eq!([front, back].map(|part| scene.materials[part as usize].diffuse.x), [0.25, 0.75]);

    let (outer, scene) =
        shown("<bsdf type='mask'><float name='opacity' value='0.25'/><bsdf type='dielectric'/></bsdf>");
    let Surface::Blend(opaque, nothing) = outer.surface else { panic!("{:?}", outer.surface) };
    let surfaces = [opaque, nothing].map(|part| scene.materials[part as usize].surface);
    assert_eq!((surfaces, outer.weight), ([Surface::Dielectric, Surface::Nothing], 0.25));

    // The weight of a blend is that of the second one.
    let (outer, scene) = shown(
        "<bsdf type='blendbsdf'><float name='weight' value='0.25'/><bsdf type='null'/><bsdf type='dielectric'/></bsdf>",
    );
    let Surface::Blend(first, _) = outer.surface else { panic!("{:?}", outer.surface) };
    assert_eq!((scene.materials[first as usize].surface, outer.weight), (Surface::Dielectric, 0.25));
}

#[test]
fn textures_lie_as_mitsuba_has_them() {
    let board = |name: &str, plugin: &str| {
        format!(
            "<bsdf type='{plugin}'><texture type='checkerboard' name='{name}'><float name='color0' value='0.25'/>\
             <float name='color1' value='0.75'/><transform name='to_uv'><scale x='5' y='5'/></transform></texture></bsdf>"
        )
    };
    let (outer, scene) = shown(&board("reflectance", "diffuse"));
    let Surface::Sides { front, .. } = outer.surface else { panic!("{:?}", outer.surface) };
    let texture = &scene.textures[scene.materials[front as usize].texture(Parameter::Diffuse).unwrap() as usize];
    let rows: Vec<f32> = texture.texels.iter().map(|texel| texel[0].to_f32()).collect();
    // Mitsuba's first row is at v = 0, which ours has at v = 1.
    assert_eq!(
        (rows, texture.lookup.wrap, texture.lookup.is_smooth),
        (vec![0.25, 0.75, 0.75, 0.25], Wrap::Repeat, false)
    );
    let uv = texture.lookup.transform.transform_point2(Vec2::new(0.05, 0.02));
    assert!(uv.abs_diff_eq(Vec2::new(0.25, 0.9), 1e-6), "{uv}");

    // Where it gives numbers, the other colour comes first.
    let (outer, scene) = shown(&board("alpha", "roughconductor"));
    let Surface::Sides { front, .. } = outer.surface else { panic!("{:?}", outer.surface) };
    let texture = scene.materials[front as usize].texture(Parameter::Roughness).unwrap();
    assert_eq!(scene.textures[texture as usize].texels[0][0].to_f32(), 0.75);
}

#[test]
fn principled_materials_keep_their_parameters() {
    let body = front(
        "<bsdf type='principled'><rgb name='base_color' value='0.2 0.8 0.1'/><float name='roughness' value='0.5'/>\
         <texture type='checkerboard' name='sheen'/><float name='clearcoat' value='0.5'/>\
         <float name='clearcoat_gloss' value='1'/><float name='metallic' value='0.25'/></bsdf>",
    );
    assert_eq!((body.surface, body.diffuse), (Surface::Principled, Vec3::new(0.2, 0.8, 0.1)));
    assert_eq!((body.roughness, body.metalness, body.coat), (Vec2::splat(0.25), 0.25, 0.5));
    assert!((body.ior - 1.5).abs() < 1e-6 && (body.coat_roughness - 0.001).abs() < 1e-6);
    assert!(body.texture(Parameter::Sheen).is_some() && !body.has_inside() && !body.is_anisotropic());

    // What light gets into has two sides of its own.
    let (glassy, _) = shown("<bsdf type='principled'><float name='spec_trans' value='0.5'/></bsdf>");
    assert!(glassy.surface == Surface::Principled && glassy.has_inside());
    let (sheet, scene) = shown(
        "<bsdf type='principledthin'><float name='eta' value='1.33'/><float name='anisotropic' value='0.5'/>\
         <texture type='checkerboard' name='diff_trans'><float name='color0' value='0.5'/>\
         <float name='color1' value='2'/></texture></bsdf>",
    );
    assert!(sheet.surface == Surface::PrincipledThin && sheet.is_anisotropic());
    let texture = &scene.textures[sheet.texture(Parameter::DiffuseTransmission).unwrap() as usize];
    let mut shares: Vec<f32> = texture.texels.iter().map(|texel| texel[0].to_f32()).collect();
    shares.sort_by(f32::total_cmp);
    assert_eq!(shares, [0.25, 0.25, 1.0, 1.0]);
}

#[test]
fn maps_turn_normals_of_what_they_are_around() {
    let board = "<texture type='checkerboard'/>";
    let bump =
        front(&format!("<bsdf type='bumpmap'><float name='scale' value='2'/>{board}<bsdf type='diffuse'/></bsdf>"));
    assert!(bump.texture(Parameter::Height).is_some() && bump.diffuse == Vec3::splat(0.5));
    let normal = front(
        "<bsdf type='normalmap'><texture type='rawconstant' name='normalmap'><vector name='value' value='0.5 0.5 1'/></texture>\
         <bsdf type='diffuse'/></bsdf>",
    );
    assert!(normal.texture(Parameter::Normal).is_some());
}

// Light

#[test]
fn emitters_become_lights() {
    let lit = scene(
        "<shape type='rectangle'/><emitter type='point'><point name='position' x='1' y='2' z='3'/><rgb name='intensity' value='4'/></emitter>\
         <emitter type='spot'><transform name='to_world'><lookat origin='0 0 5' target='0 0 0' up='0 1 0'/></transform></emitter>\
         <emitter type='directional'><vector name='direction' value='0 -2 0'/></emitter>",
    );
    assert_eq!(lit.lights[0], Light::Point { position: dvec3(1.0, 2.0, 3.0), intensity: Vec3::splat(4.0) });
    let Light::Spot { position, direction, angles, falloff, .. } = lit.lights[1] else { panic!("{:?}", lit.lights) };
    assert_eq!((position, angles, falloff), (5.0 * DVec3::Z, [15.0, 20.0], Falloff::Angle));
    assert!(direction.abs_diff_eq(DVec3::NEG_Z, 1e-12));
    assert_eq!(lit.lights[2], Light::Directional { direction: DVec3::NEG_Y, irradiance: Vec3::ONE });

    let (lamp, _) = shown("<emitter type='area'><rgb name='radiance' value='3'/></emitter>");
    assert!(lamp.only_emits() && lamp.emission == Vec3::splat(3.0));
    let (lamp, _) = shown("<bsdf type='diffuse'/><emitter type='area'/>");
    assert!(lamp.is_emitter() && !lamp.only_emits() && matches!(lamp.surface, Surface::Sides { .. }));
}

#[test]
fn images_of_the_sky_are_turned_half_way_round() {
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(4, 2, image::Rgb([255; 3])).write_to(&mut png, image::ImageFormat::Png).unwrap();
    let text = "<scene version='3.0.0'><shape type='rectangle'/><emitter type='envmap'>\
        <string name='filename' value='sky.png'/><float name='scale' value='3'/>\
        <transform name='to_world'><rotate x='1' angle='90'/><translate x='9'/></transform></emitter></scene>";
    let files: &[(&str, &[u8])] = &[("s.xml", text.as_bytes()), ("sky.png", png.get_ref())];
    let scene = load_with(files, &LoadOptions::default()).unwrap();
    let Environment::LatLong(map) = &scene.environment else { panic!("{:?}", scene.environment) };
    // Of two rows on the poles there are four in between.
    assert_eq!((map.width, map.height, map.radiance[0]), (4, 4, Vec3::splat(3.0)));
    // The centre of our image looks along -z, the left edge of Mitsuba's; up stays up.
    let expected = DMat3::from_rotation_x(90_f64.to_radians()) * DMat3::from_diagonal(dvec3(-1.0, 1.0, -1.0));
    assert!(map.rotation.abs_diff_eq(expected, 1e-12), "{}", map.rotation);
}

// Sensors and integrators

#[test]
fn sensors_become_cameras() {
    let body = |plugin: &str, more: &str| {
        format!(
            "{RECTANGLE}<sensor type='{plugin}'>{more}<film type='hdrfilm'><integer name='width' value='200'/>\
             <integer name='height' value='100'/><rfilter type='box'/></film><sampler type='independent'>\
             <integer name='sample_count' value='7'/></sampler></sensor>"
        )
    };
    let looking =
        "<transform name='to_world'><scale value='1.5'/><lookat origin='0 0 5' target='0 0 0' up='0 1 0'/></transform>";
    let seen = scene(&body("perspective", &format!("{looking}<float name='fov' value='90'/>")));
    assert!(seen.camera.eye == 5.0 * DVec3::Z && seen.camera.up.abs_diff_eq(DVec3::Y, 1e-12));
    assert!((seen.camera.target - seen.camera.eye).abs_diff_eq(DVec3::NEG_Z, 1e-12));
    assert!((seen.camera.vfov - 2.0 * 0.5_f64.atan().to_degrees()).abs() < 1e-9, "{}", seen.camera.vfov);
    let settings = seen.settings;
    assert_eq!((settings.width, settings.height, settings.samples), (200, 100, 7));
    assert_eq!(settings.sampler, Sampler::Independent);
    for (axis, vfov) in [("y", 90.0), ("smaller", 90.0), ("larger", 53.130_102_354_155_98)] {
        let fov = format!("<float name='fov' value='90'/><string name='fov_axis' value='{axis}'/>");
        assert!((scene(&body("perspective", &fov)).camera.vfov - vfov).abs() < 1e-9, "{axis}");
    }
    // 2 x 1.5 wide, and half as high.
    assert_eq!(scene(&body("orthographic", looking)).camera.orthographic, Some(1.5));
    let lens =
        scene(&body("thinlens", "<float name='aperture_radius' value='0.1'/><float name='focus_distance' value='3'/>"));
    assert_eq!((lens.camera.aperture, lens.camera.focus), (0.1, 3.0));
    assert!(warns(&scene(&body("perspective", "<integer name='x' value='1'/>")), "`x` has no effect"));
}

#[test]
fn integrators_become_settings() {
    let settings = |integrator: &str| scene(&format!("{RECTANGLE}{integrator}")).settings;
    let path = settings(
        "<integrator type='moment'><integrator type='path'><integer name='max_depth' value='8'/></integrator></integrator>",
    );
    assert_eq!((path.integrator, path.max_bounces), (Integrator::Mis, Some(7)));
    let path = settings("<integrator type='path'/>");
    assert_eq!((path.max_bounces, path.roulette_mode, path.roulette_from), (None, RouletteMode::Throughput, 4));
    path.validate().unwrap();
    assert_eq!(settings("<integrator type='direct'/>").max_bounces, Some(1));
}

// Anything

proptest! {
    #[test]
    fn no_scene_is_too_strange(at in 0_usize..1400, byte in any::<u8>(), cut in any::<bool>()) {
        let text = "<scene version='3.0.0'><default name='a' value='1'/><integrator type='path'><integer name='max_depth' \
            value='-1'/></integrator><sensor type='thinlens'><float name='fov' value='45'/><transform name='to_world'>\
            <lookat origin='0 0 5' target='0 0 0' up='0 1 0'/></transform><film type='hdrfilm'><integer name='width' value='8'/>\
            </film></sensor><bsdf type='blendbsdf' id='b'><float name='weight' value='$a'/><bsdf type='diffuse'>\
            <spectrum name='reflectance' value='400:0.2, 500:0.5'/></bsdf><bsdf type='roughplastic'/></bsdf>\
            <shape type='cube'><ref id='b'/><emitter type='area'><rgb name='radiance' value='1 2 3'/></emitter>\
            <transform name='to_world'><rotate x='1' angle='3'/><matrix value='1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1'/></transform>\
            </shape><emitter type='spot'/></scene>";
        let mut bytes = text.as_bytes().to_vec();
        let at = at.min(bytes.len() - 1);
        bytes[at] = byte;
        if cut {
            bytes.truncate(at);
        }
        let files: &[(&str, &[u8])] = &[("s.xml", &bytes)];
        for lenient in [false, true] {
            let _ = load_with(files, &LoadOptions { lenient, ..Default::default() });
        }
    }
}

/// The file is one that users have.
#[test]
fn a_scene_is_known_by_its_extension() {
    assert!(Scene::load(Path::new("none.XML")).expect_err("there is none").to_string().contains("cannot read"));
}
