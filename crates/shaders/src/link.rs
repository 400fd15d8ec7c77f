//! Functions of one SPIR-V module put in place of instructions of another.

use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;

use rspirv::dr::{Function, Instruction, Module, Operand};
use rspirv::spirv::Op;

use crate::ids::{function_id, is_line, names};

/// A module of functions, each found by its name and the types of its parameters.
#[derive(Debug)]
pub struct Library {
    module: Module,
    /// Places of the functions, by the names that the GLSL compiler gives them: `portable_dot(vf3;vf3;`.
    functions: HashMap<String, usize>,
    /// Global instructions by id.
    globals: HashMap<u32, usize>,
}

impl Library {
    /// Of SPIR-V words in native byte order.
    ///
    /// # Panics
    /// When they are no SPIR-V.
    pub fn of_words(spirv: &[u8]) -> Self {
        let words: Vec<u32> =
            spirv.chunks_exact(4).map(|word| u32::from_ne_bytes(word.try_into().expect("four"))).collect();
        Self::new(rspirv::dr::load_words(&words).expect("a library is SPIR-V"))
    }

    /// Of a module that has the names of its functions.
    pub fn new(module: Module) -> Self {
        let names = names(&module);
        let functions = module.functions.iter().enumerate();
        let functions = functions.filter_map(|(place, f)| Some((names.get(&function_id(f))?.clone(), place))).collect();
        let globals = module.types_global_values.iter().enumerate();
        let globals = globals.filter_map(|(place, instruction)| Some((instruction.result_id?, place))).collect();
        Self { module, functions, globals }
    }
}

/// Replaces every instruction that `chosen` names a function for by a call of that function of `library`, with the
/// instruction's operands. It is asked about the functions that come in for it too, but for those that `is_final`
/// takes by name, and what these call.
///
/// # Errors
/// When the library has no function of that name for those operands.
pub fn link(
    target: &mut Module,
    library: &Library,
    chosen: impl Fn(&Instruction, &Values) -> Option<&'static str>,
    is_final: impl Fn(&str) -> bool,
) -> Result<(), String> {
    let names = names(target);
    let finals = target.functions.iter().map(function_id).filter(|id| names.get(id).is_some_and(|name| is_final(name)));
    let mut linker = Linker {
        library,
        finals: finals.collect(),
        values: Values::of(target),
        next: target.header.as_ref().expect("a module has a header").bound,
        target,
        imported: HashMap::new(),
        globals: HashMap::new(),
    };
    // The functions that come in are added to the end, and have their turn.
    let mut place = 0;
    while place < linker.target.functions.len() {
        if !linker.finals.contains(&function_id(&linker.target.functions[place])) {
            linker.replace_in(place, &chosen, &is_final)?;
        }
        place += 1;
    }
    linker.target.header.as_mut().expect("as above").bound = linker.next;
    Ok(())
}

/// What is known of ids: the types of values, and the instructions of types and constants.
#[derive(Debug, Default)]
pub struct Values {
    types: HashMap<u32, u32>,
    globals: HashMap<u32, Instruction>,
}

impl Values {
    fn of(module: &Module) -> Self {
        let mut values = Self::default();
        for instruction in &module.types_global_values {
            values.note(instruction);
            values.globals.extend(instruction.result_id.map(|id| (id, instruction.clone())));
        }
        module.functions.iter().flat_map(Function::all_inst_iter).for_each(|instruction| values.note(instruction));
        values
    }

    fn note(&mut self, instruction: &Instruction) {
        if let (Some(id), Some(of)) = (instruction.result_id, instruction.result_type) {
            self.types.insert(id, of);
        }
    }

    /// Whether an operand is the constant of those bits, or a vector of it alone.
    pub fn is_constant(&self, operand: &Operand, bits: u32) -> bool {
        let Some(constant) = operand.id_ref_any().and_then(|id| self.globals.get(&id)) else { return false };
        match constant.class.opcode {
            Op::Constant => constant.operands.first() == Some(&Operand::LiteralBit32(bits)),
            Op::ConstantComposite => constant.operands.iter().all(|part| self.is_constant(part, bits)),
            _ => false,
        }
    }

    /// The type of a value as the names of functions have it: `f1;`, `vf3;`, `u1;`.
    fn type_name(&self, value: u32) -> Option<String> {
        let of = self.globals.get(self.types.get(&value)?)?;
        let (scalar, count) = match (of.class.opcode, &of.operands[..]) {
            (Op::TypeVector, [Operand::IdRef(scalar), Operand::LiteralBit32(count)]) => {
                (self.globals.get(scalar)?, *count)
            }
            _ => (of, 1),
        };
        let letter = match (scalar.class.opcode, scalar.operands.get(1)) {
            (Op::TypeFloat, _) => "f",
            (Op::TypeBool, _) => "b",
            (Op::TypeInt, Some(Operand::LiteralBit32(0))) => "u",
            (Op::TypeInt, _) => "i",
            _ => return None,
        };
        Some(if count == 1 { format!("{letter}1;") } else { format!("v{letter}{count};") })
    }
}

struct Linker<'a> {
    library: &'a Library,
    target: &'a mut Module,
    values: Values,
    /// Ids of functions whose instructions stay.
    finals: HashSet<u32>,
    /// Ids of functions of the library, by their places there.
    imported: HashMap<usize, u32>,
    /// Ids of types, constants and sets of instructions of the library, by their ids there.
    globals: HashMap<u32, u32>,
    next: u32,
}

impl Linker<'_> {
    fn new_id(&mut self) -> u32 {
        self.next += 1;
        self.next - 1
    }

    fn replace_in(
        &mut self,
        place: usize,
        chosen: &impl Fn(&Instruction, &Values) -> Option<&'static str>,
        is_final: &impl Fn(&str) -> bool,
    ) -> Result<(), String> {
        let mut blocks = std::mem::take(&mut self.target.functions[place].blocks);
        for instruction in blocks.iter_mut().flat_map(|block| &mut block.instructions) {
            let Some(name) = chosen(instruction, &self.values) else { continue };
            let extended = instruction.class.opcode == Op::ExtInst;
            let mut operands = instruction.operands.split_off(if extended { 2 } else { 0 });
            let mut wanted = format!("{name}(");
            for operand in &operands {
                let of = operand.id_ref_any().and_then(|id| self.values.type_name(id));
                write!(wanted, "{}", of.unwrap_or_else(|| "?;".to_owned())).expect("strings grow");
            }
            let found = self.library.functions.get(&wanted);
            let found =
                *found.ok_or_else(|| format!("no function {wanted} stands for {:?}", instruction.class.opcode))?;
            operands.insert(0, Operand::IdRef(self.function(found, false, is_final)));
            *instruction = Instruction::new(Op::FunctionCall, instruction.result_type, instruction.result_id, operands);
        }
        self.target.functions[place].blocks = blocks;
        Ok(())
    }

    /// The id of a function of the library, which is brought in if it is not there.
    fn function(&mut self, place: usize, final_caller: bool, is_final: &impl Fn(&str) -> bool) -> u32 {
        if let Some(id) = self.imported.get(&place) {
            return *id;
        }
        let library = self.library;
        let mut function = library.module.functions[place].clone();
        let name = library.functions.iter().find(|(_, at)| **at == place).map_or("", |(name, _)| name);
        let stays = final_caller || is_final(name);
        let mut ids: HashMap<u32, u32> = HashMap::new();
        for id in function.all_inst_iter().filter_map(|instruction| instruction.result_id) {
            ids.insert(id, self.new_id());
        }
        let id = ids[&function_id(&function)];
        self.imported.insert(place, id);
        if stays {
            self.finals.insert(id);
        }
        for block in &mut function.blocks {
            block.instructions.retain(|i| !is_line(i));
        }
        for instruction in function.all_inst_iter_mut() {
            let mut renamed = |id: u32| match (ids.get(&id), library.globals.contains_key(&id)) {
                (Some(own), _) => *own,
                (None, true) => self.global(id),
                (None, false) => match library.module.functions.iter().position(|f| function_id(f) == id) {
                    Some(called) => self.function(called, stays, is_final),
                    None => self.instruction_set(),
                },
            };
            rename(instruction, &mut renamed);
        }
        function.all_inst_iter().for_each(|instruction| self.values.note(instruction));
        let named = vec![Operand::IdRef(id), Operand::LiteralString(name.to_owned())];
        self.target.debug_names.push(Instruction::new(Op::Name, None, None, named));
        self.target.functions.push(function);
        id
    }

    /// The id of a type or a constant of the library: types must not stand in a module twice.
    fn global(&mut self, id: u32) -> u32 {
        if let Some(known) = self.globals.get(&id) {
            return *known;
        }
        let mut instruction = self.library.module.types_global_values[self.library.globals[&id]].clone();
        instruction.result_id = None;
        rename(&mut instruction, &mut |id| self.global(id));
        let same = |other: &&Instruction| {
            other.class.opcode == instruction.class.opcode
                && other.result_type == instruction.result_type
                && other.operands == instruction.operands
        };
        let there = self.target.types_global_values.iter().find(same).and_then(|other| other.result_id);
        let found = there.unwrap_or_else(|| {
            let new = self.new_id();
            instruction.result_id = Some(new);
            self.values.note(&instruction);
            self.values.globals.insert(new, instruction.clone());
            self.target.types_global_values.push(instruction);
            new
        });
        self.globals.insert(id, found);
        found
    }

    /// The id of GLSL's set of instructions, the only one that libraries use.
    fn instruction_set(&mut self) -> u32 {
        let there = self.target.ext_inst_imports.first().and_then(|import| import.result_id);
        there.unwrap_or_else(|| {
            let id = self.new_id();
            let name = vec![Operand::LiteralString("GLSL.std.450".to_owned())];
            self.target.ext_inst_imports.push(Instruction::new(Op::ExtInstImport, None, Some(id), name));
            id
        })
    }
}

/// Gives an instruction other ids.
fn rename(instruction: &mut Instruction, new: &mut impl FnMut(u32) -> u32) {
    if let Some(id) = &mut instruction.result_type {
        *id = new(*id);
    }
    if let Some(id) = &mut instruction.result_id {
        *id = new(*id);
    }
    for id in instruction.operands.iter_mut().filter_map(Operand::id_ref_any_mut) {
        *id = new(*id);
    }
}

#[cfg(test)]
mod tests {
    use rspirv::dr::Builder;

    use super::*;
    use crate::small;

    /// `half(x)` = `twice(x) * x`, which is no half.
    fn library() -> Library {
        let mut b = small::builder();
        let twice = small::float_function(&mut b, "twice(f1;", 1, |b, float, x| {
            b.f_add(float, None, x[0], x[0]).expect("a block is open")
        });
        small::float_function(&mut b, "half(f1;", 1, |b, float, x| {
            let doubled = b.function_call(float, None, twice, [x[0]]).expect("a block is open");
            b.f_mul(float, None, doubled, x[0]).expect("a block is open")
        });
        Library::new(b.module())
    }

    /// A function that negates twice.
    fn target() -> Module {
        let mut b = small::builder();
        small::float_function(&mut b, "f(f1;", 1, |b: &mut Builder, float, x| {
            let once = b.f_negate(float, None, x[0]).expect("a block is open");
            b.f_negate(float, None, once).expect("a block is open")
        });
        b.module()
    }

    fn halves(instruction: &Instruction, _: &Values) -> Option<&'static str> {
        (instruction.class.opcode == Op::FNegate).then_some("half")
    }

    fn count(module: &Module, op: Op) -> usize {
        module.all_inst_iter().filter(|i| i.class.opcode == op).count()
    }

    #[test]
    fn functions_come_in_once_with_what_they_call_and_types_are_shared() {
        let mut module = target();
        link(&mut module, &library(), halves, |_| false).expect("the library has them");
        assert_eq!(count(&module, Op::FNegate), 0);
        assert_eq!(module.functions.len(), 3, "f, half and twice");
        assert_eq!(count(&module, Op::FunctionCall), 3, "two halves, and one of twice");
        assert_eq!(count(&module, Op::TypeFloat), 1);
        let ids: Vec<u32> = module.all_inst_iter().filter_map(|i| i.result_id).collect();
        let bound = module.header.as_ref().expect("a module has a header").bound;
        assert!(ids.iter().all(|id| *id < bound));
        assert_eq!(ids.iter().collect::<HashSet<_>>().len(), ids.len(), "no id is given twice");
        let named: HashSet<String> = names(&module).into_values().collect();
        assert!(named.contains("half(f1;") && named.contains("twice(f1;"));
    }

    #[test]
    fn what_comes_in_is_replaced_too_unless_it_is_final() {
        let sums = |instruction: &Instruction, _: &Values| match instruction.class.opcode {
            Op::FNegate => Some("half"),
            Op::FMul => Some("product"),
            _ => None,
        };
        // There is no product.
        let error = link(&mut target(), &library(), sums, |_| false).expect_err("half multiplies");
        assert!(error.contains("no function product(f1;f1; stands for FMul"), "{error}");
        link(&mut target(), &library(), sums, |name| name.starts_with("half")).expect("half is final");
    }

    #[test]
    fn constants_are_known_by_their_bits_and_types() {
        let mut b = small::builder();
        let float = b.type_float(32, None);
        let vector = b.type_vector(float, 2);
        let [one, two] = [1.0_f32, 2.0].map(|value| b.constant_bit32(float, value.to_bits()));
        let [ones, mixed] = [[one, one], [one, two]].map(|parts| b.constant_composite(vector, parts));
        let values = Values::of(&b.module());
        let is_one = |id| values.is_constant(&Operand::IdRef(id), 1.0_f32.to_bits());
        assert!(is_one(one) && is_one(ones));
        assert!(!is_one(two) && !is_one(mixed));
        assert_eq!([one, ones].map(|id| values.type_name(id)), ["f1;", "vf2;"].map(|name| Some(name.to_owned())));
    }
}
