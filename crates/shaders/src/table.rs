//! Kernels as Rust: the text that a build script writes of them.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use crate::kernel::Binding;
use crate::reflection::{Layout, Reflection};

/// SPIR-V words deflated (zlib) for a [`Kernel`](crate::Kernel): the lowest bytes of all first, then the second ones,
/// and so on. So alike bytes stand together, and a sixth less is left than of the words as they are.
pub fn deflate(words: &[u32]) -> Vec<u8> {
    let planes: Vec<u8> = (0..4).flat_map(|place| words.iter().map(move |word| word.to_le_bytes()[place])).collect();
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(&planes).expect("memory takes all");
    encoder.finish().expect("memory takes all")
}

/// SPIR-V on its way into Rust text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BuiltModule {
    /// The file of its deflated words.
    pub file: PathBuf,
    /// Bytes of that file.
    pub size: usize,
    /// What was read from it.
    pub reflection: Reflection,
    /// The same where it reads the scene by texels.
    pub by_texels: Reflection,
}

/// Kernels on their way into Rust text. The text names [`Kernel`](crate::Kernel) and what it is made of, which must be
/// in scope where it is included.
#[derive(Debug, Default)]
pub struct Table {
    /// An initialiser for each kernel.
    entries: String,
    /// Names of the kernels, in the order of the entries.
    kernels: Vec<String>,
    /// Names of the buffers that they bind.
    buffers: BTreeSet<String>,
    /// An initialiser for each layout that they declare.
    structs: BTreeSet<String>,
    /// Each is in the program once, whatever forms it has: as a static with a name, for what has none is copied to each unit
    /// of code that refers to it.
    modules: Vec<BuiltModule>,
}

impl Table {
    /// Adds a kernel, or the form of one whose rays are in packets.
    pub fn add(&mut self, kernel: &str, built: &BuiltModule, in_packets: bool) {
        let module = self.modules.iter().position(|known| known.file == built.file).unwrap_or_else(|| {
            self.modules.push(built.clone());
            self.modules.len() - 1
        });
        let bindings = |reflection: &Reflection| -> String {
            let bindings: Vec<String> = reflection.bindings.iter().map(binding).collect();
            bindings.join(", ")
        };
        writeln!(
            self.entries,
            "    Kernel {{ name: {kernel:?}, deflated: &MODULE_{module}, in_packets: {in_packets}, bindings: &[{}], texel_bindings: &[{}], push_constant_size: {} }},",
            bindings(&built.reflection),
            bindings(&built.by_texels),
            built.reflection.push_constant_size
        )
        .expect("strings grow");
        self.buffers.extend(built.reflection.bindings.iter().map(|binding| binding.name.clone()));
        self.structs.extend(built.reflection.structs.iter().chain(&built.by_texels.structs).map(layout));
        self.kernels.push(kernel.to_owned());
    }

    /// The static of that name with every kernel in the order in which they were added; and each kernel and the name of
    /// each buffer as an item of its own, so that a misspelt one does not compile.
    pub fn kernels(&self, name: &str) -> String {
        let allow = "#[allow(dead_code, reason = \"not every kernel and buffer is named\")]";
        let mut text = String::new();
        for (index, BuiltModule { file, size, .. }) in self.modules.iter().enumerate() {
            writeln!(text, "static MODULE_{index}: [u8; {size}] = *include_bytes!({file:?});").expect("strings grow");
        }
        write!(text, "/// Every kernel, sorted by name.\npub static {name}: &[Kernel] = &[\n").expect("strings grow");
        text += &self.entries;
        write!(text, "];\n/// Every kernel by name.\n{allow}\npub mod kernels {{\n    use super::Kernel;\n")
            .expect("strings grow");
        for (index, kernel) in self.kernels.iter().enumerate() {
            let item = kernel.to_uppercase();
            writeln!(text, "    /// `{kernel}`.\n    pub const {item}: &Kernel = &super::{name}[{index}];")
                .expect("strings grow");
        }
        write!(text, "}}\n/// Names of the buffers that kernels bind.\n{allow}\npub mod buffers {{\n")
            .expect("strings grow");
        for buffer in &self.buffers {
            let item = buffer.to_uppercase();
            writeln!(text, "    /// `{buffer}`.\n    pub const {item}: &str = {buffer:?};").expect("strings grow");
        }
        text + "}\n"
    }

    /// The static of that name with every layout that some kernel declares, sorted by name.
    pub fn structs(&self, name: &str) -> String {
        let entries: String = self.structs.iter().map(|entry| format!("    {entry},\n")).collect();
        format!(
            "/// Every block and struct with a memory layout that some kernel declares.\npub static {name}: &[StructLayout] = &[\n{entries}];\n"
        )
    }
}

fn binding(of: &Binding<String>) -> String {
    let Binding { name, set, binding, kind, reads, writes } = of;
    format!(
        "Binding {{ name: {name:?}, set: {set}, binding: {binding}, kind: BindingKind::{kind:?}, reads: {reads}, writes: {writes} }}"
    )
}

fn layout(of: &Layout) -> String {
    // A member shows itself as the Rust that makes it.
    let members: Vec<String> = of.members.iter().map(|member| format!("{member:?}")).collect();
    format!("StructLayout {{ name: {:?}, members: &[{}] }}", of.name, members.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{BindingKind, Kernel, Member, StructLayout};

    #[test]
    fn words_are_what_was_deflated() {
        let words: Vec<u32> = (0..1000_u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
        let kernel = |words| Kernel {
            name: "kernel",
            deflated: deflate(words).leak(),
            in_packets: false,
            bindings: &[],
            texel_bindings: &[],
            push_constant_size: 0,
        };
        assert_eq!(kernel(&words).words(), words);
        assert_eq!(kernel(&[]).words(), []);
    }

    #[test]
    fn a_table_is_rust_text() {
        let hits = Binding {
            name: "hits".to_owned(),
            set: 1,
            binding: 2,
            kind: BindingKind::StorageBuffer,
            reads: true,
            writes: false,
        };
        let member = Member { name: "count".to_owned(), offset: 4, size: 12, array_stride: 0 };
        let control = StructLayout { name: "Control".to_owned(), members: vec![member] };
        let reflection = Reflection { bindings: vec![hits], push_constant_size: 8, structs: vec![control] };
        let mut table = Table::default();
        let by_texels = reflection.clone();
        let built = BuiltModule { file: PathBuf::from("shade.zlib"), size: 5, reflection, by_texels };
        table.add("shade", &built, false);
        table.add("shade_packets", &built, true);
        let hits = r#"&[Binding { name: "hits", set: 1, binding: 2, kind: BindingKind::StorageBuffer, reads: true, writes: false }]"#;
        let text = table.kernels("KERNELS");
        for (name, in_packets) in [("shade", false), ("shade_packets", true)] {
            let entry = format!(
                "    Kernel {{ name: {name:?}, deflated: &MODULE_0, in_packets: {in_packets}, bindings: {hits}, texel_bindings: {hits}, push_constant_size: 8 }},\n"
            );
            assert!(text.contains(&entry), "{text}");
        }
        assert_eq!(text.matches("static MODULE_0: [u8; 5] = *include_bytes!(\"shade.zlib\");").count(), 1);
        assert!(text.contains("pub const SHADE: &Kernel = &super::KERNELS[0];"));
        assert!(text.contains("pub const HITS: &str = \"hits\";"));
        let control = r#"StructLayout { name: "Control", members: &[Member { name: "count", offset: 4, size: 12, array_stride: 0 }] }"#;
        assert_eq!(table.structs("STRUCTS").matches(control).count(), 1, "layouts that are alike are one");
    }
}
