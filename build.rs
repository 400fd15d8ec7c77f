//! Compiles every kernel of `shaders/` to SPIR-V and writes the kernel table; and the probes of
//! `tests/shaders/`, kernels that let the tests call single functions, what `shaders/facts/` measures a device by, and
//! the kernels of the self-test, each into a table of its own.
//!
//! Each `NAME.comp` is compiled once for every [`Edition`] and every [`variant::Access`]. From the SPIR-V itself
//! come the bindings, their access, the push-constant size and the block layouts that the tests
//! compare with the Rust structs. Every shader error is reported before the build fails. Every arithmetic is tried on
//! every kernel; the host puts one into a kernel when it builds it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, process, thread};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use rspirv::binary::Assemble;
use rspirv::dr::{Block, Instruction, Module, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op, StorageClass};

#[allow(dead_code, reason = "the build needs only the tables")]
#[path = "src/constants.rs"]
mod constants;

#[allow(dead_code, reason = "the build tries every arithmetic and uses none")]
#[path = "src/shaders/arithmetic.rs"]
mod arithmetic;
#[allow(dead_code, reason = "as above")]
#[path = "src/shaders/link.rs"]
mod link;
#[path = "src/shaders/variant.rs"]
mod variant;

use arithmetic::{Arithmetic, Form, Forms};
use constants::{Specialization, SpecializationConstant};
use link::Library;
use variant::{Edition, variants};

/// Libraries of functions that the host puts in place of a kernel's operations, with the names of their statics.
const LIBRARIES: [(&str, &str); 2] =
    [("PORTABLE", "shaders/arithmetic/portable.glsl"), ("HOSTILE", "tests/shaders/hostile.glsl")];

/// Kernels that are built from another's file: name, file and the macro that makes them what they are.
const FORMS: [(&str, &str, &str); 4] = [
    ("bounce_packets", "bounce", "PACKETS"),
    ("connect_packets", "connect", "PACKETS"),
    ("extend_packets", "extend", "PACKETS"),
    ("traversal_packets", "traversal", "PACKETS"),
];

/// Where the kernels' own functions lie, and then what the self-test's kernels share, and probes.
const INCLUDES: [&str; 3] = ["shaders/include", SELFTEST, PROBES];

/// The folder of the self-test's kernels, which need only the plain edition.
const SELFTEST: &str = "shaders/selftest";

/// The probes' folder. A packaged source need not have it.
const PROBES: &str = "tests/shaders";
/// Kernels that measure what a device is like.
const FACTS: &str = "shaders/facts";

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let version = process::Command::new(env::var_os("RUSTC").expect("cargo sets RUSTC")).arg("--version").output();
    let version = version.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    println!("cargo::rustc-env=RAYWAVE_RUSTC_VERSION={}", version.unwrap_or_default());
    for source in [
        "shaders",
        PROBES,
        "src/constants.rs",
        "src/shaders/arithmetic.rs",
        "src/shaders/link.rs",
        "src/shaders/variant.rs",
    ] {
        println!("cargo::rerun-if-changed={source}");
    }
    let [(portable, portable_entry), (_, hostile_entry)] = match compile_libraries(&out) {
        Ok(libraries) => libraries,
        Err(error) => {
            eprintln!("{error}");
            process::exit(1);
        }
    };
    forget_others(&out);
    let kernels = Table::of("shaders", &Edition::ALL, Some(&portable), &out);
    let probes = Table::of(PROBES, &[Edition::Plain], Some(&portable), &out);
    // They ask what the device itself does.
    let [facts, selftest] = [FACTS, SELFTEST].map(|folder| Table::of(folder, &[Edition::Plain], None, &out));

    let tables = [&kernels, &probes, &facts, &selftest];
    let errors: Vec<_> = tables.into_iter().flat_map(|table| &table.errors).cloned().collect();
    if !errors.is_empty() {
        eprintln!("{}", errors.join("\n"));
        process::exit(1);
    }
    let structs = kernels.structs.iter().fold(String::new(), |list, entry| list + "    " + entry + ",\n");
    let text = format!(
        "/// Every kernel, sorted by name.\npub static KERNELS: &[Kernel] = &[\n{}];\n\
         /// Every block and struct with a memory layout that some kernel declares.\npub static STRUCTS: &[StructLayout] = &[\n{structs}];\n{portable_entry}{}",
        kernels.entries,
        kernels.names("KERNELS")
    );
    fs::write(out.join("kernels.rs"), text).expect("OUT_DIR can be written");
    let tables = [
        ("PROBES", "probes.rs", probes, hostile_entry),
        ("FACTS", "facts.rs", facts, String::new()),
        ("SELFTEST", "selftest.rs", selftest, String::new()),
    ];
    for (name, file, table, more) in tables {
        let doc = "/// Every kernel, sorted by name.\n";
        let names = table.names(name);
        let text = format!("{doc}pub static {name}: &[Kernel] = &[\n{}];\n{more}{names}", table.entries);
        fs::write(out.join(file), text).expect("OUT_DIR can be written");
    }
}

/// The kernels of a folder as Rust text.
#[derive(Default)]
struct Table {
    /// An initialiser for each kernel, sorted by name.
    entries: String,
    /// One for each layout that they declare, sorted by name.
    structs: BTreeSet<String>,
    /// Names of the kernels, in the order of the entries, and of the buffers that they bind.
    kernels: Vec<String>,
    buffers: BTreeSet<String>,
    errors: Vec<String>,
}

impl Table {
    fn of(folder: &str, editions: &[Edition], portable: Option<&Library>, out: &Path) -> Self {
        let mut paths: Vec<PathBuf> = match fs::read_dir(folder) {
            Ok(entries) => entries.map(|entry| entry.expect("a shader folder can be read").path()).collect(),
            Err(_) if folder == PROBES => Vec::new(),
            Err(error) => return Self { errors: vec![format!("{folder}: {error}")], ..Self::default() },
        };
        paths.retain(|path| path.extension().is_some_and(|extension| extension == "comp"));
        // Name, file, and the macro of a form.
        let mut kernels: Vec<(String, PathBuf, Option<&'static str>)> = Vec::new();
        for path in paths {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let forms = FORMS.iter().filter(|(_, file, _)| *file == name);
            kernels.extend(forms.map(|(form, _, macro_name)| ((*form).to_owned(), path.clone(), Some(*macro_name))));
            kernels.push((name, path, None));
        }
        kernels.sort();

        // In threads: the kernels take half a minute one after the other.
        thread::scope(|scope| {
            let of = |(name, path, form): &(String, PathBuf, Option<&'static str>)| {
                let (name, path, form) = (name.clone(), path.clone(), *form);
                scope.spawn(move || Self::of_kernel(folder, &name, &path, form, editions, portable, out))
            };
            let threads: Vec<_> = kernels.iter().map(of).collect();
            threads.into_iter().fold(Self::default(), |mut all, kernel| {
                let kernel = kernel.join().expect("a kernel that does not compile is an error of its table");
                all.entries += &kernel.entries;
                all.structs.extend(kernel.structs);
                all.kernels.extend(kernel.kernels);
                all.buffers.extend(kernel.buffers);
                all.errors.extend(kernel.errors);
                all
            })
        })
    }

    /// Each kernel and the name of each buffer as an item of its own, so that a misspelt one does not compile. `table` is
    /// the static that holds the entries.
    fn names(&self, table: &str) -> String {
        let allow = "#[allow(dead_code, reason = \"not every kernel and buffer is named\")]";
        let mut text = format!("/// Every kernel by name.\n{allow}\npub mod kernels {{\n    use super::Kernel;\n");
        for (index, name) in self.kernels.iter().enumerate() {
            let item = name.to_uppercase();
            writeln!(text, "    /// `{name}`.\n    pub const {item}: &Kernel = &super::{table}[{index}];")
                .expect("strings grow");
        }
        writeln!(text, "}}\n/// Names of the buffers that kernels bind.\n{allow}\npub mod buffers {{")
            .expect("strings grow");
        for name in &self.buffers {
            let item = name.to_uppercase();
            writeln!(text, "    /// `{name}`.\n    pub const {item}: &str = {name:?};").expect("strings grow");
        }
        text + "}\n"
    }

    /// A kernel that its file is, or that the macro of a form makes of it.
    fn of_kernel(
        folder: &str,
        name: &str,
        path: &Path,
        form: Option<&'static str>,
        editions: &[Edition],
        portable: Option<&Library>,
        out: &Path,
    ) -> Self {
        let mut table = Self { kernels: vec![name.to_owned()], ..Self::default() };
        let compiler = shaderc::Compiler::new().expect("the shaderc compiler starts");
        let source = fs::read_to_string(path).expect("a listed shader can be read");
        writeln!(table.entries, "    Kernel {{ name: {name:?}, variants: &[").expect("strings grow");
        // Variants that read alike are one.
        let mut entries: BTreeMap<String, String> = BTreeMap::new();
        for (index, (edition, access)) in variants(editions).enumerate() {
            let macros: Vec<&str> = access.macro_names().chain(edition.macro_name()).chain(form).collect();
            let options = kernel_options(&macros);
            let file = out.join(format!("{}.{name}.{index}.spv", folder.replace('/', "-")));
            let built = preprocess(&compiler, path, &source, &options).and_then(|text| {
                if let Some(entry) = entries.get(&text) {
                    return Ok(entry.clone());
                }
                let module = match kept(&file, &text) {
                    Some(module) => module,
                    None => {
                        let module = compile(&compiler, path, &source, &options)?;
                        check(path, &module, portable)?;
                        keep(&file, &text, &module);
                        module
                    }
                };
                let reflection = Reflection::of(&module);
                let entry = reflection.entry(&file, module);
                table.structs.extend(reflection.structs);
                table.buffers.extend(reflection.buffers);
                entries.insert(text, entry.clone());
                Ok(entry)
            });
            match built {
                Ok(entry) => writeln!(table.entries, "{entry}").expect("strings grow"),
                // The variants fail alike: one report a kernel is enough.
                Err(error) if table.errors.is_empty() => table.errors.push(error),
                Err(_) => {}
            }
        }
        writeln!(table.entries, "    ] }},").expect("strings grow");
        table
    }
}

/// The libraries, with the initialisers of their statics.
fn compile_libraries(out: &Path) -> Result<[(Library, String); 2], String> {
    let compiler = shaderc::Compiler::new().expect("the shaderc compiler starts");
    let compile = |name: &str, path: &str| -> Result<(Library, String), String> {
        // A packaged source need not have the tests'.
        let source = fs::read_to_string(path).unwrap_or_else(|_| "#version 460\nvoid main() {}\n".to_owned());
        // The optimizer would leave no function.
        let options = compile_options(shaderc::OptimizationLevel::Zero);
        let artifact = compiler
            .compile_into_spirv(&source, shaderc::ShaderKind::Compute, path, "main", Some(&options))
            .map_err(|error| error.to_string())?;
        let mut module = rspirv::dr::load_words(artifact.as_binary()).map_err(|error| format!("{path}: {error}"))?;
        // Names are what functions are found by; the source text is of no use.
        remove_source(&mut module);
        let file = out.join(format!("{name}.spv"));
        fs::write(&file, to_bytes(&module)).expect("OUT_DIR can be written");
        let doc = format!("/// SPIR-V of `{path}`.\n");
        Ok((Library::new(module), format!("{doc}pub static {name}: &[u8] = include_bytes!({file:?});\n")))
    };
    let [portable, hostile] = LIBRARIES.map(|(name, path)| compile(name, path));
    Ok([portable?, hostile?])
}

fn to_bytes(module: &Module) -> Vec<u8> {
    module.assemble().iter().flat_map(|word| word.to_ne_bytes()).collect()
}

/// Fails where a kernel that renders counts invocations by another workgroup size than the host's, or an arithmetic has
/// no form of an operation of it, or leaves one to the driver.
fn check(path: &Path, module: &Module, portable: Option<&Library>) -> Result<(), String> {
    let Some(portable) = portable else { return Ok(()) };
    if counts_invocations_without_the_constant(module) {
        let path = path.display();
        return Err(format!("{path}: its code reads a workgroup size that is not the constant which the host sets"));
    }
    for form in [Form::Native, Form::ByFma, Form::ByIntegers] {
        let arithmetic = Arithmetic::Portable(Forms { division: form, reciprocal: form, root: form });
        arithmetic::lower(&mut module.clone(), arithmetic, portable, None)
            .map_err(|error| format!("{}: {error}; see docs/numerics.md", path.display()))?;
    }
    Ok(())
}

/// Fails where a kernel reads the size of its workgroup before it declares it: the compiler takes it to be 1 there.
fn declares_before_it_reads(path: &str, preprocessed: &str) -> Result<(), String> {
    let Some(read) = preprocessed.find("gl_WorkGroupSize") else { return Ok(()) };
    if preprocessed.find("local_size_x").is_some_and(|declared| declared < read) {
        return Ok(());
    }
    Err(format!("{path}: gl_WorkGroupSize is read before its declaration, where it is 1; include workgroup.glsl first"))
}

/// Whether the code counts the invocations of a launch by something else than the constant that holds the size of a
/// workgroup: the number of workgroups is of no other use.
fn counts_invocations_without_the_constant(module: &Module) -> bool {
    let decorated = |decoration: &[Operand]| {
        let decorates = |i: &&Instruction| i.class.opcode == Op::Decorate && i.operands[1..] == *decoration;
        let ids = module.annotations.iter().filter(decorates).map(|i| id_of(&i.operands[0]));
        ids.collect::<BTreeSet<u32>>()
    };
    let names = |i: &Instruction, ids: &BTreeSet<u32>| {
        i.operands.iter().filter_map(Operand::id_ref_any).any(|id| ids.contains(&id))
    };
    let code = || module.functions.iter().flat_map(|function| function.all_inst_iter());
    let size = [Operand::Decoration(Decoration::SpecId), Operand::LiteralBit32(workgroup_size_id())];
    let mut size = decorated(&size);
    for made in &module.types_global_values {
        if names(made, &size) {
            size.extend(made.result_id);
        }
    }
    let groups = decorated(&[Operand::Decoration(Decoration::BuiltIn), Operand::BuiltIn(BuiltIn::NumWorkgroups)]);
    code().any(|i| names(i, &groups)) && !code().any(|i| names(i, &size))
}

fn compile_options(level: shaderc::OptimizationLevel) -> shaderc::CompileOptions<'static> {
    let mut options = shaderc::CompileOptions::new().expect("shaderc options start");
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_2 as u32);
    options.set_optimization_level(level);
    // Keeps the names that libraries are searched by, and that the reflection and the layout tests read.
    options.set_generate_debug_info();
    options.set_warnings_as_errors();
    options
}

fn kernel_options(macros: &[&str]) -> shaderc::CompileOptions<'static> {
    let mut options = compile_options(shaderc::OptimizationLevel::Performance);
    for name in macros {
        options.add_macro_definition(name, Some("1"));
    }
    options.set_include_callback(|requested, _, _, _| {
        if let Some(content) = generated(requested) {
            return Ok(shaderc::ResolvedInclude { resolved_name: requested.to_owned(), content });
        }
        let found = INCLUDES.iter().map(|folder| format!("{folder}/{requested}")).find(|path| Path::new(path).exists());
        let resolved_name = found.ok_or_else(|| format!("{requested} is in none of {INCLUDES:?}"))?;
        let content = fs::read_to_string(&resolved_name).map_err(|error| format!("{resolved_name}: {error}"))?;
        Ok(shaderc::ResolvedInclude { resolved_name, content })
    });
    options
}

/// A variant's text with its includes, and without what its macros leave out.
fn preprocess(
    compiler: &shaderc::Compiler,
    path: &Path,
    source: &str,
    options: &shaderc::CompileOptions<'_>,
) -> Result<String, String> {
    let path = path.to_string_lossy();
    let artifact = compiler.preprocess(source, &path, "main", Some(options)).map_err(|error| error.to_string())?;
    let text = artifact.as_text();
    declares_before_it_reads(&path, &text)?;
    Ok(text)
}

/// Compiles one variant of a kernel.
fn compile(
    compiler: &shaderc::Compiler,
    path: &Path,
    source: &str,
    options: &shaderc::CompileOptions<'_>,
) -> Result<Module, String> {
    let path = path.to_string_lossy();
    let artifact = compiler
        .compile_into_spirv(source, shaderc::ShaderKind::Compute, &path, "main", Some(options))
        .map_err(|error| error.to_string())?;
    let mut module = rspirv::dr::load_words(artifact.as_binary()).map_err(|error| format!("{path}: {error}"))?;
    keep_loops_in_variables(&mut module);
    if !has_source() {
        remove_source(&mut module);
    }
    Ok(module)
}

/// Whether kernels carry their source, by the feature `shader-source`.
fn has_source() -> bool {
    env::var_os("CARGO_FEATURE_SHADER_SOURCE").is_some()
}

/// Takes out the source text, and the lines that instructions come from: more than half of a module, of use to
/// profilers only.
fn remove_source(module: &mut Module) {
    module.debug_string_source.clear();
    module.types_global_values.retain(|i| !matches!(i.class.opcode, Op::Line | Op::NoLine));
    for block in module.functions.iter_mut().flat_map(|function| &mut function.blocks) {
        block.instructions.retain(|i| !matches!(i.class.opcode, Op::Line | Op::NoLine));
    }
}

/// The module that an earlier build made of this very text; `None` where there is none.
fn kept(file: &Path, text: &str) -> Option<Module> {
    let same = fs::read_to_string(file.with_extension("glsl")).is_ok_and(|kept| kept == text);
    let bytes = fs::read(file).ok().filter(|_| same)?;
    rspirv::dr::load_bytes(bytes).ok()
}

/// Keeps a module for [`kept`].
fn keep(file: &Path, text: &str, module: &Module) {
    fs::write(file, to_bytes(module)).expect("OUT_DIR can be written");
    fs::write(file.with_extension("glsl"), text).expect("OUT_DIR can be written");
}

/// Forgets what is kept, unless the same build script made it with the same library: what they do to a module is no part
/// of its text.
fn forget_others(out: &Path) {
    let script = env::current_exe().and_then(fs::read).expect("a build script can read itself");
    let portable = fs::read(out.join("PORTABLE.spv")).expect("the library was just written");
    let mut hasher = DefaultHasher::new();
    (script, portable, env::var_os("CARGO_FEATURE_SHADER_SOURCE")).hash(&mut hasher);
    let (file, stamp) = (out.join("stamp"), hasher.finish().to_string());
    if fs::read_to_string(&file).is_ok_and(|kept| kept == stamp) {
        return;
    }
    for entry in fs::read_dir(out).expect("OUT_DIR can be read").flatten() {
        if entry.path().extension().is_some_and(|extension| extension == "glsl") {
            fs::remove_file(entry.path()).expect("OUT_DIR can be written");
        }
    }
    fs::write(file, stamp).expect("OUT_DIR can be written");
}

/// The text of an include that is written here, from what Rust says.
fn generated(include: &str) -> Option<String> {
    match include {
        "constants.glsl" => Some(glsl_constants()),
        "specialization_constants.glsl" => Some(glsl_specialization_constants()),
        "listed_triangles.glsl" => Some(glsl_listed_triangles()),
        _ => None,
    }
}

fn glsl_constants() -> String {
    constants::GLSL.iter().fold(String::new(), |mut text, (name, value)| {
        writeln!(text, "#define {name} {value}u").expect("strings grow");
        text
    })
}

/// A declaration of each specialization constant, under its meaning. The size of a workgroup is declared by
/// `workgroup.glsl`, in the syntax that GLSL has for it alone, and has its id here.
fn glsl_specialization_constants() -> String {
    Specialization::TABLE.iter().enumerate().fold(String::new(), |mut text, (id, constant)| {
        let SpecializationConstant { name, rust_type, default, meaning } = constant;
        let glsl_name = name.to_uppercase();
        writeln!(text, "//{meaning}").expect("strings grow");
        let declared = if id as u32 == workgroup_size_id() {
            writeln!(text, "#define {glsl_name}_ID {id}u")
        } else if *rust_type == "bool" {
            writeln!(text, "layout(constant_id = {id}) const bool {glsl_name} = {};", *default != 0)
        } else {
            writeln!(text, "layout(constant_id = {id}) const uint {glsl_name} = {default}u;")
        };
        declared.expect("strings grow");
        text
    })
}

fn workgroup_size_id() -> u32 {
    let id = Specialization::TABLE.iter().position(|constant| constant.name == "workgroup_size");
    id.expect("the table has the size of a workgroup") as u32
}

/// The specialization constants that hold the vertices of listed triangles, and an initialiser of an
/// array of the vertices: GLSL has no constant arrays of specialization constants.
fn glsl_listed_triangles() -> String {
    let floats = 0..9 * constants::LISTED_TRIANGLES;
    let mut text = floats.fold(String::new(), |mut text, i| {
        let id = Specialization::TABLE.len() as u32 + i;
        writeln!(text, "layout(constant_id = {id}) const float LISTED_{i} = 0.0;").expect("strings grow");
        text
    });
    let vertices = (0..3 * constants::LISTED_TRIANGLES).map(|v| {
        let i = 3 * v;
        format!("vec3(LISTED_{i}, LISTED_{}, LISTED_{})", i + 1, i + 2)
    });
    let vertices: Vec<_> = vertices.collect();
    writeln!(text, "#define LISTED_VERTICES vec3[]({})", vertices.join(", ")).expect("strings grow");
    text
}

/// Makes variables again of what loops carry from turn to turn, which the optimizer has made phis.
///
/// Mesa stores a phi's value at the end of the block that it comes from. For the next turn that is the loop's continue
/// block, which Mesa puts at the start of the loop, under a flag that is false in the first turn: so each value is
/// selected by the flag at the start of every turn. What a variable is given in front of the continue block leaves it
/// empty, and there is no flag. On lavapipe traversal is 1.13 times as fast for it.
fn keep_loops_in_variables(module: &mut Module) {
    let mut bound = module.header.as_ref().expect("a module has a header").bound;
    let mut new_id = || {
        bound += 1;
        bound - 1
    };
    let mut pointers = BTreeMap::new();
    for function in &mut module.functions {
        let places: BTreeMap<u32, usize> = (0..).zip(&function.blocks).map(|(i, block)| (label(block), i)).collect();
        let mut before = vec![Vec::new(); function.blocks.len()];
        for (i, block) in function.blocks.iter().enumerate() {
            let end = block.instructions.last().expect("a block has an end");
            for target in end.operands.iter().filter_map(Operand::id_ref_any).filter_map(|id| places.get(&id)) {
                before[*target].push(i);
            }
        }
        let mut variables = Vec::new();
        let mut stores = Vec::new();
        for head in &mut function.blocks {
            if !head.instructions.iter().any(|i| i.class.opcode == Op::LoopMerge) {
                continue;
            }
            for phi in head.instructions.iter_mut().filter(|i| i.class.opcode == Op::Phi) {
                let value_type = phi.result_type.expect("a phi has a type");
                let pointer = *pointers.entry(value_type).or_insert_with(&mut new_id);
                let variable = new_id();
                let class = Operand::StorageClass(StorageClass::Function);
                variables.push(Instruction::new(Op::Variable, Some(pointer), Some(variable), vec![class]));
                for pair in phi.operands.chunks_exact(2) {
                    stores.push((places[&id_of(&pair[1])], variable, pair[0].clone()));
                }
                let from = vec![Operand::IdRef(variable)];
                *phi = Instruction::new(Op::Load, Some(value_type), phi.result_id, from);
            }
        }
        for (place, variable, value) in stores {
            let is_code = |i: &&Instruction| !matches!(i.class.opcode, Op::Line | Op::NoLine);
            let is_empty = function.blocks[place].instructions.iter().filter(is_code).count() == 1;
            let passed = is_empty && !before[place].is_empty();
            for place in if passed { before[place].clone() } else { vec![place] } {
                let code = &mut function.blocks[place].instructions;
                let merges = |i: &Instruction| matches!(i.class.opcode, Op::SelectionMerge | Op::LoopMerge);
                let end = code.iter().position(merges).unwrap_or(code.len() - 1);
                let operands = vec![Operand::IdRef(variable), value.clone()];
                code.insert(end, Instruction::new(Op::Store, None, None, operands));
            }
        }
        if let Some(first) = function.blocks.first_mut() {
            first.instructions.splice(..0, variables);
        }
    }
    for (value_type, id) in pointers {
        let operands = vec![Operand::StorageClass(StorageClass::Function), Operand::IdRef(value_type)];
        module.types_global_values.push(Instruction::new(Op::TypePointer, None, Some(id), operands));
    }
    module.header.as_mut().expect("as above").bound = bound;
}

fn label(block: &Block) -> u32 {
    block.label.as_ref().and_then(|label| label.result_id).expect("a block has a label")
}

/// What the host must know of a kernel, read from its SPIR-V.
struct Reflection {
    bindings: Vec<String>,
    /// Names of what it binds.
    buffers: Vec<String>,
    push_constant_size: u32,
    structs: Vec<String>,
}

impl Reflection {
    fn of(module: &Module) -> Self {
        let (mut bindings, mut buffers) = (Vec::new(), Vec::new());
        let mut push_constant_size = 0;
        for variable in module.types_global_values.iter().filter(|i| i.class.opcode == Op::Variable) {
            let id = variable.result_id.expect("a variable has an id");
            let Operand::StorageClass(class) = variable.operands[0] else { continue };
            let pointer = definition(module, variable.result_type.expect("a variable has a type"));
            let pointee = definition(module, id_of(&pointer.operands[1]));
            if class == StorageClass::PushConstant {
                push_constant_size = struct_size(module, pointee);
            }
            let (Some(set), Some(binding)) =
                (decoration(module, id, Decoration::DescriptorSet), decoration(module, id, Decoration::Binding))
            else {
                continue;
            };
            let kind = match (class, pointee.class.opcode) {
                (StorageClass::Uniform, _) => "UniformBuffer",
                (StorageClass::StorageBuffer, _) => "StorageBuffer",
                (StorageClass::UniformConstant, Op::TypeSampledImage) => "UniformTexelBuffer",
                _ => panic!("a binding of a kind that the host does not know: {variable:?}"),
            };
            let (reads, writes) = accesses(module, id);
            let name = name_of(module, id);
            buffers.push(name.clone());
            bindings.push((
                (set, binding),
                format!("Binding {{ name: {name:?}, set: {set}, binding: {binding}, kind: BindingKind::{kind}, reads: {reads}, writes: {writes} }}"),
            ));
        }
        bindings.sort();
        Self {
            bindings: bindings.into_iter().map(|(_, entry)| entry).collect(),
            buffers,
            push_constant_size,
            structs: struct_layouts(module),
        }
    }

    /// The entry of a module, which is deflated into a file beside its own; names are for profilers that show sources.
    fn entry(&self, file: &Path, mut module: Module) -> String {
        if !has_source() {
            module.debug_names.clear();
        }
        let deflated = file.with_extension("zlib");
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
        // The bytes of all words by their place in a word: alike ones stand together, and a sixth less is left.
        let words = module.assemble();
        let planes: Vec<u8> = (0..4).flat_map(|place| words.iter().map(move |w| w.to_le_bytes()[place])).collect();
        encoder.write_all(&planes).expect("memory takes all");
        fs::write(&deflated, encoder.finish().expect("memory takes all")).expect("OUT_DIR can be written");
        format!(
            "        Variant {{ deflated: include_bytes!({:?}), bindings: &[{}], push_constant_size: {} }},",
            deflated,
            self.bindings.join(", "),
            self.push_constant_size
        )
    }
}

fn definition(module: &Module, id: u32) -> &Instruction {
    module
        .types_global_values
        .iter()
        .find(|instruction| instruction.result_id == Some(id))
        .expect("SPIR-V defines each type that it names")
}

fn id_of(operand: &Operand) -> u32 {
    operand.id_ref_any().expect("the operand is an id")
}

fn name_of(module: &Module, id: u32) -> String {
    module
        .debug_names
        .iter()
        .find(|i| i.class.opcode == Op::Name && id_of(&i.operands[0]) == id)
        .map(|i| i.operands[1].unwrap_literal_string().to_owned())
        .unwrap_or_default()
}

fn member_name(module: &Module, id: u32, member: u32) -> String {
    module
        .debug_names
        .iter()
        .find(|i| {
            i.class.opcode == Op::MemberName
                && id_of(&i.operands[0]) == id
                && i.operands[1] == Operand::LiteralBit32(member)
        })
        .map(|i| i.operands[2].unwrap_literal_string().to_owned())
        .unwrap_or_default()
}

fn decoration(module: &Module, id: u32, wanted: Decoration) -> Option<u32> {
    module
        .annotations
        .iter()
        .find(|i| {
            i.class.opcode == Op::Decorate
                && id_of(&i.operands[0]) == id
                && i.operands[1] == Operand::Decoration(wanted)
        })
        .map(|i| match i.operands.get(2) {
            Some(Operand::LiteralBit32(value)) => *value,
            _ => 1,
        })
}

fn member_decoration(module: &Module, id: u32, member: u32, wanted: Decoration) -> Option<u32> {
    module
        .annotations
        .iter()
        .find(|i| {
            i.class.opcode == Op::MemberDecorate
                && id_of(&i.operands[0]) == id
                && i.operands[1] == Operand::LiteralBit32(member)
                && i.operands[2] == Operand::Decoration(wanted)
        })
        .map(|i| match i.operands.get(3) {
            Some(Operand::LiteralBit32(value)) => *value,
            _ => 1,
        })
}

/// Whether the kernel's code reads and writes the variable, through whatever pointer.
fn accesses(module: &Module, variable: u32) -> (bool, bool) {
    let mut pointers = vec![variable];
    let (mut reads, mut writes) = (false, false);
    for instruction in module.functions.iter().flat_map(|function| function.all_inst_iter()) {
        let Some(Operand::IdRef(first)) = instruction.operands.first() else { continue };
        if !pointers.contains(first) {
            continue;
        }
        match instruction.class.opcode {
            Op::AccessChain | Op::InBoundsAccessChain | Op::CopyObject => pointers.extend(instruction.result_id),
            Op::Load => reads = true,
            Op::Store => writes = true,
            Op::AtomicIAdd | Op::AtomicOr | Op::AtomicUMax | Op::AtomicUMin => (reads, writes) = (true, true),
            other => panic!("a buffer is used in a way that the host does not know: {other:?}"),
        }
    }
    (reads, writes)
}

/// Bytes that a type takes up, by its explicit offsets and strides; 0 for a runtime array.
fn type_size(module: &Module, id: u32) -> u32 {
    let instruction = definition(module, id);
    let literal = |index: usize| match instruction.operands[index] {
        Operand::LiteralBit32(value) => value,
        _ => panic!("a literal was expected in {instruction:?}"),
    };
    match instruction.class.opcode {
        Op::TypeInt | Op::TypeFloat => literal(0) / 8,
        Op::TypeVector => type_size(module, id_of(&instruction.operands[0])) * literal(1),
        Op::TypeStruct => struct_size(module, instruction),
        Op::TypeArray => {
            let length = definition(module, id_of(&instruction.operands[1]));
            let Operand::LiteralBit32(count) = length.operands[0] else {
                panic!("an array length is a 32-bit constant")
            };
            decoration(module, id, Decoration::ArrayStride).unwrap_or(0) * count
        }
        Op::TypeRuntimeArray => 0,
        other => panic!("a block member of a type that the host does not know: {other:?}"),
    }
}

fn struct_size(module: &Module, instruction: &Instruction) -> u32 {
    let id = instruction.result_id.expect("a type has an id");
    instruction
        .operands
        .iter()
        .enumerate()
        .map(|(member, type_id)| {
            member_decoration(module, id, member as u32, Decoration::Offset).unwrap_or(0)
                + type_size(module, id_of(type_id))
        })
        .max()
        .unwrap_or(0)
}

fn struct_layouts(module: &Module) -> Vec<String> {
    let mut layouts = Vec::new();
    for instruction in module.types_global_values.iter().filter(|i| i.class.opcode == Op::TypeStruct) {
        let id = instruction.result_id.expect("a type has an id");
        if member_decoration(module, id, 0, Decoration::Offset).is_none() {
            continue;
        }
        let name = name_of(module, id);
        let members: Vec<String> = instruction
            .operands
            .iter()
            .enumerate()
            .map(|(member, type_id)| {
                let member = member as u32;
                let type_id = id_of(type_id);
                let stride = decoration(module, type_id, Decoration::ArrayStride).unwrap_or(0);
                format!(
                    "Member {{ name: {:?}, offset: {}, size: {}, array_stride: {stride} }}",
                    member_name(module, id, member),
                    member_decoration(module, id, member, Decoration::Offset)
                        .expect("every member of a laid-out struct has an offset"),
                    type_size(module, type_id),
                )
            })
            .collect();
        layouts.push(format!("StructLayout {{ name: {name:?}, members: &[{}] }}", members.join(", ")));
    }
    layouts
}
