//! The gallery's mesh, streamed as OBJ text: memory does not grow with the number of triangles.

use std::io::{self, Write};

use glam::{DVec3, dvec3};

use super::{
    hall::{HALL, boxes, shapes},
    surfaces::{Seam, Shape},
};
use raywave::scene::shapes::{CUBOID_FACES, cuboid_corners};

/// The whole mesh. Shapes share the triangles that the flat parts leave, by weight.
pub fn write(out: &mut dyn Write, triangles: usize) -> io::Result<()> {
    let boxes = boxes();
    let shapes = shapes();
    let budget = triangles.saturating_sub(2 + boxes.len() * 12);
    let weight: f64 = shapes.iter().map(|shape| shape.weight).sum();

    let mut mesh = ObjWriter::new(out);
    mesh.preamble()?;
    mesh.floor()?;
    for (material, low, high) in boxes {
        mesh.cuboid(material, low, high)?;
    }
    for shape in &shapes {
        mesh.shape(shape, budget as f64 * shape.weight / weight)?;
    }
    Ok(())
}

/// Streams OBJ text and knows the next free indices.
pub struct ObjWriter<W> {
    out: W,
    material: &'static str,
    positions: usize,
    normals: usize,
}

impl<W: Write> ObjWriter<W> {
    /// A mesh without faces.
    pub fn new(out: W) -> Self {
        Self { out, material: "", positions: 0, normals: 0 }
    }

    /// What stands above the faces.
    pub fn preamble(&mut self) -> io::Result<()> {
        writeln!(self.out, "# The gallery, generated.\nmtllib gallery.mtl")
    }

    fn use_material(&mut self, material: &'static str) -> io::Result<()> {
        if self.material != material {
            self.material = material;
            writeln!(self.out, "usemtl {material}")?;
        }
        Ok(())
    }

    fn position(&mut self, point: DVec3) -> io::Result<()> {
        self.positions += 1;
        writeln!(self.out, "v {:.6} {:.6} {:.6}", point.x, point.y, point.z)
    }

    /// The floor, its texture repeated every two metres.
    pub fn floor(&mut self) -> io::Result<()> {
        let (low, high) = HALL;
        self.use_material("floor")?;
        for (x, z) in [(low.x, high.z), (high.x, high.z), (high.x, low.z), (low.x, low.z)] {
            writeln!(self.out, "vt {:.4} {:.4}", 0.5 * x, -0.5 * z)?;
            self.position(dvec3(x, 0.0, z))?;
        }
        writeln!(self.out, "f 1/1 2/2 3/3 4/4")
    }

    /// Six quads that face outwards.
    pub fn cuboid(&mut self, material: &'static str, low: DVec3, high: DVec3) -> io::Result<()> {
        self.use_material(material)?;
        let base = self.positions + 1;
        for corner in cuboid_corners(low, high) {
            self.position(corner)?;
        }
        for face in CUBOID_FACES {
            let [a, b, c, d] = face.map(|corner| base + corner);
            writeln!(self.out, "f {a} {b} {c} {d}")?;
        }
        Ok(())
    }

    /// A shape as a grid of about `triangles` triangles.
    pub fn shape(&mut self, shape: &Shape, triangles: f64) -> io::Result<()> {
        const FEWEST: f64 = 6.0;
        let has_poles = shape.seam == Seam::Poles;
        // A quad is two triangles, but one where it touches a pole.
        let full_rows = (0.5 * triangles / shape.aspect).sqrt().round().max(FEWEST);
        let columns = (0.5 * triangles / full_rows).round().max(FEWEST);
        let rows = full_rows + f64::from(has_poles);
        let columns_of_points = columns as usize + usize::from(shape.seam == Seam::Open);
        // At a pole one point stands for its whole row.
        let rows_of_points = match shape.seam {
            Seam::Poles => rows as usize - 1,
            Seam::Torus => rows as usize,
            Seam::Open | Seam::Tube => rows as usize + 1,
        };
        let first_row = usize::from(has_poles);

        self.use_material(shape.material)?;
        let base = [self.positions + 1, self.normals + 1];
        for row in first_row..first_row + rows_of_points {
            for column in 0..columns_of_points {
                self.shape_point(shape, column as f64 / columns, row as f64 / rows)?;
            }
        }
        if has_poles {
            self.shape_point(shape, 0.0, 0.0)?;
            self.shape_point(shape, 0.0, 1.0)?;
        }

        let lower_pole = rows_of_points * columns_of_points;
        let (rows, columns) = (rows as usize, columns as usize);
        let index = |column: usize, row: usize| match (has_poles, row) {
            (true, 0) => lower_pole,
            (true, row) if row == rows => lower_pole + 1,
            _ => {
                let row = (row - first_row) % rows_of_points;
                row * columns_of_points + column % columns_of_points
            }
        };
        for row in 0..rows {
            for column in 0..columns {
                let (right, above) = (column + 1, row + 1);
                let mut corners = vec![index(column, row), index(right, row)];
                corners.extend([index(right, above), index(column, above)]);
                corners.dedup();
                self.face(&corners, base, shape.is_smooth)?;
            }
        }
        Ok(())
    }

    fn shape_point(&mut self, shape: &Shape, u: f64, v: f64) -> io::Result<()> {
        self.position((shape.point)(u, v))?;
        if shape.is_smooth {
            // Differences are taken inside the square: at a pole, du vanishes.
            const STEP: f64 = 1e-4;
            let inside = |x: f64| x.clamp(2.0 * STEP, 1.0 - 2.0 * STEP);
            let (u, v) = (inside(u), inside(v));
            let du = (shape.point)(u + STEP, v) - (shape.point)(u - STEP, v);
            let dv = (shape.point)(u, v + STEP) - (shape.point)(u, v - STEP);
            let normal = du.cross(dv).normalize_or(DVec3::Y);
            self.normals += 1;
            writeln!(self.out, "vn {:.4} {:.4} {:.4}", normal.x, normal.y, normal.z)?;
        }
        Ok(())
    }

    fn face(&mut self, corners: &[usize], base: [usize; 2], smooth: bool) -> io::Result<()> {
        self.out.write_all(b"f")?;
        for corner in corners {
            write!(self.out, " {}", base[0] + corner)?;
            if smooth {
                write!(self.out, "//{}", base[1] + corner)?;
            }
        }
        self.out.write_all(b"\n")
    }
}
