//! What Rust writes is what GLSL reads: blocks by the offsets in the SPIR-V, scene records by
//! reading them back through the functions that read them for the renderer.

use crate::common;
use std::collections::{BTreeMap, BTreeSet};
use std::f32::consts::{PI, TAU};
use std::mem::offset_of;

use crate::instances::orchard;
use crate::meshes::soup;
use crate::probe::{Bench, Uniform, any_scene, lanes, scene_of};
use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3, Vec2, Vec3};
use raywave::bvh::BvhKind;
use raywave::constants::{
    IMAGE_HEADER_WORDS, INSTANCE_TEXELS, LISTED_TRIANGLES, MATERIAL_DETAIL_TEXELS, MATERIAL_TEXELS, NO_TRIANGLE,
    NODE_TEXELS, PUNCTUAL_LIGHT_TEXELS, Specialization, TRIANGLE_TEXELS,
};
use raywave::layout::{
    Batch, Bins, Control, EnvironmentSplit, EnvironmentTexel, FilmPixel, Frame, Instance, Light, Material,
    MaterialDetail, Node, Normals, PlacedLight, PunctualLight, RayCount, Triangle, WorkCount,
};
use raywave::render::{PreparedScene, TriangleName};
use raywave::scene::{Environment, EnvironmentMap};
use raywave::settings::Instances;
use raywave::shaders::{Access, KERNELS, STRUCTS, SWITCHES, StructLayout};
use rspirv::dr::Operand;
use rspirv::spirv::Decoration;

/// Name, offset and size of the fields of a struct: all of them, or it does not compile.
macro_rules! fields_of {
    ($struct:ident { $($field:ident),* $(,)? }) => {{
        let $struct { $($field),* } = <$struct as Zeroable>::zeroed();
        vec![$((stringify!($field), offset_of!($struct, $field), size_of_val(&$field))),*]
    }};
}

/// A field's name, offset and size.
type Field = (&'static str, usize, usize);

/// Sizes and fields of the structs that are blocks in GLSL.
fn blocks() -> BTreeMap<&'static str, (usize, Vec<Field>)> {
    BTreeMap::from([
        (
            "Frame",
            (
                size_of::<Frame>(),
                fields_of!(Frame {
                    camera_eye,
                    lens_radius,
                    camera_right,
                    focus_distance,
                    camera_up,
                    roulette,
                    camera_forward,
                    max_bounces,
                    environment_radiance,
                    seed,
                    environment_x,
                    punctual_count,
                    environment_y,
                    punctual_probability,
                    environment_z,
                    width,
                    height,
                    light_count,
                    sky_probability,
                    environment_width,
                    environment_height,
                    path_capacity,
                    environment,
                    radiance_clamp,
                    roulette_from,
                    camera_distance,
                    is_orthographic,
                    height_scale,
                }),
            ),
        ),
        (
            "Control",
            (
                size_of::<Control>(),
                fields_of!(Control {
                    current_rays,
                    next_rays,
                    current_shadow_rays,
                    next_shadow_rays,
                    ray_groups,
                    shadow_groups,
                    nonfinite_samples,
                    cut_loops,
                    traced_samples,
                }),
            ),
        ),
        ("RayCount", (size_of::<RayCount>(), fields_of!(RayCount { rays, shadow_rays }))),
        ("WorkCount", (size_of::<WorkCount>(), fields_of!(WorkCount { items, nodes, triangles, steps }))),
        ("Bins", (size_of::<Bins>(), fields_of!(Bins { counts, places }))),
        (
            "FilmPixel",
            (size_of::<FilmPixel>(), fields_of!(FilmPixel { sum, sum_compensation, squares, squares_compensation })),
        ),
        (
            "Batch",
            (
                size_of::<Batch>(),
                fields_of!(Batch {
                    first_pixel,
                    pixel_count,
                    first_sample,
                    sample_count,
                    bounce,
                    film_pixel,
                    first_slot
                }),
            ),
        ),
    ])
}

/// Structs that GLSL reads as texels of bits: their names and bytes, and bytes of a texel.
fn records() -> BTreeMap<&'static str, (usize, usize)> {
    BTreeMap::from([
        ("Node", (size_of::<Node>(), 16 * NODE_TEXELS as usize)),
        ("Triangle", (size_of::<Triangle>(), 16 * TRIANGLE_TEXELS as usize)),
        ("Material", (size_of::<Material>(), 16 * MATERIAL_TEXELS as usize)),
        ("MaterialDetail", (size_of::<MaterialDetail>(), 16 * MATERIAL_DETAIL_TEXELS as usize)),
        ("PunctualLight", (size_of::<PunctualLight>(), 16 * PUNCTUAL_LIGHT_TEXELS as usize)),
        ("Light", (size_of::<Light>(), 16)),
        ("PlacedLight", (size_of::<PlacedLight>(), 8)),
        ("Instance", (size_of::<Instance>(), 16 * INSTANCE_TEXELS as usize)),
        ("Normals", (size_of::<Normals>(), 16)),
        ("EnvironmentTexel", (size_of::<EnvironmentTexel>(), 16)),
        ("EnvironmentSplit", (size_of::<EnvironmentSplit>(), 16)),
    ])
}

#[test]
fn blocks_lie_in_rust_as_in_spirv() {
    for (name, (size, fields)) in blocks() {
        let layouts: Vec<&StructLayout> = STRUCTS.iter().filter(|layout| layout.name == name).collect();
        assert_eq!(layouts.len(), 1, "one layout of {name} in all kernels");
        let members: Vec<_> = layouts[0].members.iter().map(|m| (m.name, m.offset as usize, m.size as usize)).collect();
        assert_eq!(fields, members, "{name}");
        assert_eq!(
            fields.iter().map(|(_, offset, size)| offset + size).max(),
            Some(size),
            "{name} ends with its last field"
        );
    }
}

#[test]
fn every_specialization_constant_is_some_kernels() {
    let mut ids = BTreeSet::new();
    for kernel in KERNELS {
        let module = kernel.module();
        ids.extend(module.annotations.iter().filter_map(|i| match i.operands[1..] {
            [Operand::Decoration(Decoration::SpecId), Operand::LiteralBit32(id)] => Some(id),
            _ => None,
        }));
    }
    for (constant, id) in Specialization::TABLE.iter().zip(0..) {
        assert!(ids.contains(&id), "no kernel has {}", constant.name);
    }
    assert!(SWITCHES.iter().all(|switch| ids.remove(&switch.id)), "the switches are above the host's constants");
    // Behind the table are the vertices of the longest list.
    let count = Specialization::TABLE.len() as u32 + 9 * LISTED_TRIANGLES;
    assert_eq!(ids.last(), Some(&(count - 1)), "the last vertex");
    assert_eq!(Specialization::DEFAULT.words().len(), Specialization::TABLE.len());
}

#[test]
fn arrays_step_by_the_size_of_their_elements() {
    let film = STRUCTS.iter().find(|layout| layout.name == "Film").expect("resolve declares it");
    assert_eq!(film.members[0].array_stride as usize, size_of::<FilmPixel>());
    for layout in STRUCTS {
        for member in layout.members.iter().filter(|member| member.array_stride > 0) {
            let expected = match (layout.name, member.name) {
                ("Film", _) => 64,
                ("Control", "traced_samples") => 8,
                ("RayQueue" | "SortedRays" | "Control" | "RayCount" | "WorkCount" | "Bins", _) => 4,
                ("RayInstances" | "HitInstances", _) => 4,
                ("ShadowInstances" | "Buffer_placed_lights", _) => 8,
                ("WorkCounts", _) => size_of::<WorkCount>() as u32,
                ("Buffer_texture_coordinates" | "Buffer_vertex_colours" | "Buffer_textures", _) => 8,
                _ => 16,
            };
            assert_eq!(member.array_stride, expected, "{}.{}", layout.name, member.name);
        }
    }
    for (name, (size, texels)) in records() {
        assert_eq!(size, texels, "{name} is whole texels");
    }
}

#[test]
fn no_struct_is_on_one_side_alone() {
    let source = include_str!("../../src/layout.rs");
    let in_rust: BTreeSet<&str> =
        source.lines().filter_map(|line| line.strip_prefix("pub struct ")?.split([' ', '(']).next()).collect();
    let known: BTreeSet<&str> = blocks().into_keys().chain(records().into_keys()).collect();
    assert_eq!(in_rust, known, "every struct of layout.rs is compared by a test of this file");
    // In SPIR-V, a block with one runtime array is a buffer of such elements; all else has a twin.
    for layout in STRUCTS {
        let is_array = matches!(layout.members, [member] if member.size == 0);
        assert!(is_array || blocks().contains_key(layout.name), "{} has no twin in Rust", layout.name);
    }
}

/// Output of the probe `records`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Record {
    v: [[f32; 4]; 3],
    kd: [f32; 4],
    ks: [f32; 3],
    ns: f32,
    ke: [f32; 3],
    ni: f32,
    tf: [f32; 4],
    normal: [f32; 4],
    radiance: [f32; 4],
    material: u32,
    original: u32,
    surface: u32,
    unused: u32,
}

/// By texels and as storage buffers.
const ACCESSES: [Access; 2] =
    [Access { texel_fetch: true, subgroup_ballot: true }, Access { texel_fetch: false, subgroup_ballot: true }];

/// Numbers that are all different.
struct Fresh(f32);

impl Fresh {
    fn next<const N: usize>(&mut self) -> [f32; N] {
        std::array::from_fn(|_| {
            self.0 += 1.0;
            self.0
        })
    }
}

/// A sky of three texels side by side.
fn three_texels() -> Environment {
    let (radiance, rotation) = (vec![Vec3::ONE; 3], DMat3::IDENTITY);
    Environment::LatLong(EnvironmentMap { path: "sky".into(), width: 3, height: 1, radiance, rotation })
}

/// An octahedral normal in front of z = 0, and what it stands for.
fn octahedral(x: f32, y: f32) -> (u32, Vec3) {
    let snorm = |x: f32| u32::from((x * 32767.0).round() as i16 as u16);
    (snorm(x) | snorm(y) << 16, Vec3::new(x, y, 1.0 - x.abs() - y.abs()).normalize())
}

#[test]
fn triangles_materials_normals_and_texels_are_read_as_they_are_written() {
    const COUNT: u32 = 3;
    let mut scene = any_scene();
    scene.environment = three_texels();
    let mut bench = Bench::new(&common::device(), &scene);
    let mut fresh = Fresh(0.0);
    let scene = &mut bench.scene;
    scene.triangles = (0..COUNT)
        .map(|i| {
            let v0 @ [x, y, z] = fresh.next();
            // Each looks along +z, and has a place of its own in the scene's order.
            let [v1, v2] = [[x + 0.5, y, z], [x, y + 0.75, z]];
            Triangle { v0, original: COUNT - 1 - i, v1, material: 40 + i, v2, light_area: 0.0 }
        })
        .collect();
    scene.materials = (0..COUNT)
        .map(|i| Material {
            kd: fresh.next(),
            surface: 10 + i,
            ks: fresh.next(),
            ns: fresh.next::<1>()[0],
            ke: fresh.next(),
            ni: fresh.next::<1>()[0],
            tf: fresh.next(),
            map_kd: 0,
        })
        .collect();
    // The last material has an image of one texel, behind another whose header comes first.
    let colour = [0.25, 0.5, 0.75];
    let half = |x: f32| u32::from(half::f16::from_f32(x).to_bits());
    scene.materials[2].map_kd = 1 + IMAGE_HEADER_WORDS + 1;
    let header = [[1, 1], [0; 2], [1.0_f32.to_bits(), 0], [0, 1.0_f32.to_bits()], [0; 2]];
    let texel = [half(colour[0]) | half(colour[1]) << 16, half(colour[2])];
    scene.textures = [&header[..], &[[0, 0]], &header, &[texel]].concat();
    scene.texture_coordinates = vec![Vec2::ZERO; 3 * COUNT as usize];
    let corners =
        [[0.1, 0.2], [0.3, 0.4], [0.5, 0.45]].map(|[x, y]| [octahedral(x, 0.0), octahedral(0.0, y), octahedral(-x, y)]);
    scene.normals = vec![
        Normals { corners: corners[0].map(|corner| corner.0), present: 1 },
        Normals { corners: corners[1].map(|corner| corner.0), present: 0 },
        Normals { corners: corners[2].map(|corner| corner.0), present: 1 },
    ];
    scene.environment = (0..COUNT).map(|_| EnvironmentTexel { radiance: fresh.next(), probability: 0.0 }).collect();
    (scene.features.normals, scene.features.textures) = (true, true);

    let queries: Vec<[u32; 4]> = (0..COUNT).flat_map(|i| [[i, 0, 0, 0], [i, 1, 0, 0], [i, 0, 1, 0]]).collect();
    for access in ACCESSES {
        bench.access = Some(access);
        let answers: Vec<Record> = bench.run("records", &queries);
        for (query, answer) in queries.iter().zip(&answers) {
            let i = query[0] as usize;
            let Triangle { v0, original, v1, material, v2, light_area: _ } = bench.scene.triangles[i];
            assert_eq!(answer.v.map(|[x, y, z, _]| [x, y, z]), [v0, v1, v2]);
            assert_eq!((answer.material, answer.original), (material, original));
            let Material { kd, surface, ks, ns, ke, ni, tf, map_kd } = bench.scene.materials[i];
            let kd = if map_kd == 0 { kd } else { colour };
            assert_eq!((answer.kd[..3].to_vec(), answer.surface, answer.ks, answer.ns), (kd.to_vec(), surface, ks, ns));
            assert_eq!((answer.ke, answer.ni, answer.tf[..3].to_vec()), (ke, ni, tf.to_vec()));
            let corner = (query[1] + 2 * query[2]) as usize;
            let flat = bench.scene.normals[original as usize].present == 0;
            let normal = if flat { Vec3::Z } else { corners[original as usize][corner].1 };
            assert!((Vec3::from_slice(&answer.normal[..3]) - normal).length() < 1e-4, "{answer:?} is not {normal}");
            assert_eq!(answer.radiance[..3], bench.scene.environment[i].radiance);
        }
    }
}

/// Output of the probe `placed_records`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct PlacedRecord {
    v: [[f32; 4]; 3],
    normals: [[f32; 4]; 3],
    uvs: [[f32; 4]; 3],
    to_mesh: [[f32; 4]; 3],
    light_area: f32,
    root: u32,
    light: [u32; 2],
}

#[test]
fn instances_are_read_as_they_are_written() {
    let scene = orchard();
    let mut bench = Bench::new(&common::device(), &scene);
    // The same scene by the host's own hands, which flattens it.
    let [flat, placed] = [Instances::Flatten, Instances::TwoLevel]
        .map(|instances| PreparedScene::with_tree(&scene, BvhKind::Bvh2, instances).expect("the scene fits"));
    let (places, flat_places) = (placed.places(), flat.places());
    bench.scene = placed;
    let mesh_triangles = |instance: u32| if instance < 6 { 168 } else { 56 };
    let names: Vec<TriangleName> = (1..8)
        .flat_map(|instance| (0..mesh_triangles(instance)).map(move |triangle| TriangleName { instance, triangle }))
        .collect();
    let queries: Vec<[u32; 4]> = names
        .iter()
        .map(|name| {
            let (number, instance) = bench.scene.number_of(*name);
            [places[number as usize], instance, 0, 0]
        })
        .collect();
    for access in ACCESSES {
        bench.access = Some(access);
        let answers: Vec<PlacedRecord> = bench.run("placed_records", &queries);
        for ((name, query), answer) in names.iter().zip(&queries).zip(&answers) {
            let (number, _) = flat.number_of(*name);
            let Triangle { v0, v1, v2, light_area, .. } = flat.triangles[flat_places[number as usize] as usize];
            assert_eq!(answer.v.map(|[x, y, z, _]| [x, y, z]), [v0, v1, v2]);
            let Instance { root, inverse, .. } = bench.scene.bvh.instances[query[1] as usize];
            assert_eq!((answer.root, answer.to_mesh), (root, inverse));
            let normals = flat.normals[number as usize];
            let corners: [Vec3; 3] = answer.normals.map(|[x, y, z, _]| Vec3::new(x, y, z));
            let unfolded = |bits: u32| {
                let [x, y] = [bits, bits >> 16].map(|bits| f32::from((bits as u16).cast_signed()) / 32767.0);
                let fold = (x.abs() + y.abs() - 1.0).max(0.0);
                let folded = |x: f32| if x >= 0.0 { x - fold } else { x + fold };
                Vec3::new(folded(x), folded(y), 1.0 - x.abs() - y.abs()).normalize()
            };
            if normals.present != 0 {
                let near = |(a, bits): (&Vec3, u32)| a.abs_diff_eq(unfolded(bits), 1e-6);
                assert!(corners.iter().zip(normals.corners).all(near), "{corners:?} {name:?}");
                let uvs = &flat.texture_coordinates[3 * number as usize..][..3];
                assert_eq!(answer.uvs.map(|[u, v, ..]| Vec2::new(u, v)), uvs);
            }
            if light_area > 0.0 {
                assert_eq!(answer.light_area, light_area);
                // The light of that number is that triangle.
                assert_eq!(answer.light, query[..2]);
            }
        }
    }
}

/// Asks the probe `light` at the first triangle: the numbers of a sample in, radiance, direction
/// and lamp out.
fn lights_of(bench: &Bench, numbers: &[[f32; 4]]) -> Vec<([f32; 4], [f32; 4], u32)> {
    let queries: Vec<[u32; 12]> =
        numbers.iter().map(|u| bytemuck::cast([[0.0, 0.25, 0.25, 0.0], [0.0, 0.0, 1.0, 0.0], *u])).collect();
    let answers: Vec<[[u32; 4]; 6]> = bench.run("light", &queries);
    answers.iter().map(|a| (bytemuck::cast(a[3]), bytemuck::cast(a[2]), a[5][0])).collect()
}

#[test]
fn lamps_are_read_as_they_are_written() {
    let mut scene = scene_of(&[[DVec3::ZERO, DVec3::X, DVec3::Y]; 4]);
    scene.materials[0].emission = Vec3::ONE;
    let mut bench = Bench::new(&common::device(), &scene);
    let lamp = |triangle, threshold, alias| Light { triangle, threshold, alias, unused: 0 };
    bench.scene.lights = vec![lamp(1, 0.25, 1), lamp(3, 0.5, 2), lamp(2, 0.75, 0), lamp(0, 0.125, 1)];
    let lamps = &bench.scene.lights;
    let numbers: Vec<[f32; 4]> = (0..8)
        .map(|i| [0.25 * ((i / 2) as f32 + lamps[i / 2].threshold + [-1e-3, 1e-3][i % 2]), 0.5, 0.5, 0.5])
        .collect();
    let expected: Vec<u32> = (0..8)
        .map(|i| if i % 2 == 0 { lamps[i / 2].triangle } else { lamps[lamps[i / 2].alias as usize].triangle })
        .collect();
    for access in ACCESSES {
        bench.access = Some(access);
        let found: Vec<u32> = lights_of(&bench, &numbers).iter().map(|(_, _, lamp)| *lamp).collect();
        assert_eq!(found, expected);
    }
}

#[test]
fn the_sky_s_probabilities_and_splits_are_read_as_they_are_written() {
    let mut scene = any_scene();
    scene.environment = three_texels();
    let mut bench = Bench::new(&common::device(), &scene);
    let probabilities = [0.5, 0.25, 0.125];
    bench.scene.environment =
        probabilities.map(|probability| EnvironmentTexel { radiance: [1.0; 3], probability }).to_vec();
    // The whole in quarters of two by two texels, then the left and the right one of those that are there.
    bench.scene.environment_splits = [(1.0, [0.75, 0.5]), (1.0, [0.25, 0.5]), (1.0, [1.0, 0.5])]
        .map(|(upper, left)| EnvironmentSplit { upper, left, unused: 0 })
        .to_vec();
    // Of the left 3/4 a quarter is the first texel's.
    let splits = [0.0, 0.25 * 0.75, 0.75, 1.0];
    let numbers: Vec<[f32; 4]> =
        (0..6).map(|i| [splits[i / 2 + i % 2] + [1e-3, -1e-3][i % 2], 0.9, 0.5, 0.5]).collect();
    for access in ACCESSES {
        bench.access = Some(access);
        for (i, (radiance, direction, lamp)) in lights_of(&bench, &numbers).into_iter().enumerate() {
            // From the left: the columns look along -z turned by -120, 0 and 120 degrees.
            let texel = i / 2;
            let turn = (direction[0]).atan2(-direction[2]) / TAU * 3.0 + 1.0;
            assert!((turn - texel as f32).abs() < 1e-3, "{direction:?} is not in {texel}");
            let expected = 4.0 / 3.0 * PI / probabilities[texel];
            assert!((radiance[0] / expected - 1.0).abs() < 1e-3, "{radiance:?} is not {expected}");
            assert_eq!(lamp, NO_TRIANGLE);
        }
    }
}

#[test]
fn nodes_are_read_alike_whatever_the_access() {
    let mut random = Uniform::new(1);
    let mut bench = Bench::new(&common::device(), &scene_of(&soup(1000, 1.0, 1.0, &mut random)));
    let queries: Vec<[u32; 12]> = (0..10_000)
        .map(|_| {
            let origin = lanes(random.direction()).map(f32::to_bits);
            let direction = lanes(random.direction()).map(f32::to_bits);
            let [x, y, z, _] = origin;
            let [dx, dy, dz, _] = direction;
            [x, y, z, NO_TRIANGLE, dx, dy, dz, NO_TRIANGLE, 1.0_f32.to_bits(), 0, 0, 0]
        })
        .collect();
    let [by_texels, by_words] = ACCESSES.map(|access| {
        bench.access = Some(access);
        bench.run::<_, [u32; 8]>("traversal", &queries)
    });
    assert!(by_texels == by_words);
    assert!(by_texels.iter().filter(|answer| answer[0] != NO_TRIANGLE).count() > 1000);
}
