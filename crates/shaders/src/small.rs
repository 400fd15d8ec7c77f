//! Small modules for tests, and what they compute.

use std::collections::HashMap;

use rspirv::dr::{Builder, Function, Instruction, Module, Operand};
use rspirv::spirv::{
    AddressingModel, BuiltIn, Capability, Decoration, ExecutionModel, FunctionControl, LoopControl, MemoryModel, Op,
    SelectionControl, StorageClass,
};

use crate::ids::{id_of, label};

/// The id that the constants of a small kernel have their size of a workgroup under.
pub const SIZE_ID: u32 = 0;

pub fn builder() -> Builder {
    let mut b = Builder::new();
    b.set_version(1, 5);
    b.capability(Capability::Shader);
    b.memory_model(AddressingModel::Logical, MemoryModel::GLSL450);
    b
}

/// An entry point of what `code` writes into its only block.
pub fn main(b: &mut Builder, code: impl FnOnce(&mut Builder)) {
    let void = b.type_void();
    let of = b.type_function(void, []);
    let main = b.begin_function(void, None, FunctionControl::NONE, of).expect("functions do not nest");
    b.begin_block(None).expect("blocks do not nest");
    code(b);
    b.ret().expect("a block is open");
    b.end_function().expect("a function is open");
    b.entry_point(ExecutionModel::GLCompute, main, "main", []);
}

/// `buffer NAME { uint first; uint rest[]; }` with that set and binding.
pub fn buffer(b: &mut Builder, name: &str, set: u32, binding: u32) -> u32 {
    let uint = b.type_int(32, 0);
    // Types of its own, as the GLSL compiler gives each block.
    let [array, block] = [(); 2].map(|()| b.id());
    b.type_runtime_array_id(Some(array), uint);
    b.type_struct_id(Some(block), [uint, array]);
    b.decorate(array, Decoration::ArrayStride, [Operand::LiteralBit32(4)]);
    for (member, member_name) in [(0, "first"), (1, "rest")] {
        b.member_decorate(block, member, Decoration::Offset, [Operand::LiteralBit32(4 * member)]);
        b.member_name(block, member, member_name);
    }
    b.name(block, format!("{name}Block"));
    let pointer = b.type_pointer(None, StorageClass::StorageBuffer, block);
    let variable = b.variable(pointer, None, StorageClass::StorageBuffer, None);
    b.decorate(variable, Decoration::DescriptorSet, [Operand::LiteralBit32(set)]);
    b.decorate(variable, Decoration::Binding, [Operand::LiteralBit32(binding)]);
    b.name(variable, name);
    variable
}

/// A pointer to the first number of a [`buffer`].
pub fn first_of(b: &mut Builder, buffer: u32) -> u32 {
    let uint = b.type_int(32, 0);
    let zero = b.constant_bit32(uint, 0);
    let pointer = b.type_pointer(None, StorageClass::StorageBuffer, uint);
    b.access_chain(pointer, None, buffer, [zero]).expect("a block is open")
}

pub fn builtin(b: &mut Builder, which: BuiltIn) -> u32 {
    let uint = b.type_int(32, 0);
    let vector = b.type_vector(uint, 3);
    let pointer = b.type_pointer(None, StorageClass::Input, vector);
    let variable = b.variable(pointer, None, StorageClass::Input, None);
    b.decorate(variable, Decoration::BuiltIn, [Operand::BuiltIn(which)]);
    variable
}

/// `uint f(uint n)`, which goes through a loop `n` times that exchanges `a` and `b` in each turn, from 10 and 20, and gives
/// `a`. With `full`, something is done in the loop's continue block.
pub fn swapping_loop(full: bool) -> Module {
    let mut b = builder();
    let (uint, truth) = (b.type_int(32, 0), b.type_bool());
    let of = b.type_function(uint, [uint]);
    let [zero, one, ten, twenty] = [0, 1, 10, 20].map(|value| b.constant_bit32(uint, value));
    b.begin_function(uint, None, FunctionControl::NONE, of).expect("functions do not nest");
    let n = b.function_parameter(uint).expect("a function is open");
    let entry = b.begin_block(None).expect("blocks do not nest");
    let [head, test, body, next, end, stepped, a, other] = [(); 8].map(|()| b.id());
    b.branch(head).expect("a block is open");
    b.begin_block(Some(head)).expect("blocks do not nest");
    let i = b.phi(uint, None, [(zero, entry), (stepped, next)]).expect("a block is open");
    b.phi(uint, Some(a), [(ten, entry), (other, next)]).expect("a block is open");
    b.phi(uint, Some(other), [(twenty, entry), (a, next)]).expect("a block is open");
    b.loop_merge(end, next, LoopControl::NONE, []).expect("a block is open");
    b.branch(test).expect("a block is open");
    b.begin_block(Some(test)).expect("blocks do not nest");
    let goes_on = b.u_less_than(truth, None, i, n).expect("a block is open");
    b.branch_conditional(goes_on, body, end, []).expect("a block is open");
    b.begin_block(Some(body)).expect("blocks do not nest");
    let step = |b: &mut Builder| b.i_add(uint, Some(stepped), i, one).expect("a block is open");
    if !full {
        step(&mut b);
    }
    b.branch(next).expect("a block is open");
    b.begin_block(Some(next)).expect("blocks do not nest");
    if full {
        step(&mut b);
    }
    b.branch(head).expect("a block is open");
    b.begin_block(Some(end)).expect("blocks do not nest");
    b.ret_value(a).expect("a block is open");
    b.end_function().expect("a function is open");
    b.module()
}

/// Code under an `if`: `then` is written into a block that runs if `condition` holds.
pub fn under(b: &mut Builder, condition: u32, then: impl FnOnce(&mut Builder)) {
    let [inside, after] = [(); 2].map(|()| b.id());
    b.selection_merge(after, SelectionControl::NONE).expect("a block is open");
    b.branch_conditional(condition, inside, after, []).expect("a block is open");
    b.begin_block(Some(inside)).expect("blocks do not nest");
    then(b);
    b.branch(after).expect("a block is open");
    b.begin_block(Some(after)).expect("blocks do not nest");
}

/// What the first function of a module gives for its arguments: unsigned numbers, with the operations that the small
/// modules have.
pub fn run(module: &Module, arguments: &[u32]) -> u32 {
    let function: &Function = &module.functions[0];
    let mut values: HashMap<u32, u32> = HashMap::new();
    for constant in &module.types_global_values {
        if let (Op::Constant, Some(id), Operand::LiteralBit32(value)) =
            (constant.class.opcode, constant.result_id, constant.operands.first().unwrap_or(&Operand::LiteralBit32(0)))
        {
            values.insert(id, *value);
        }
        if let (Op::SpecConstantTrue | Op::SpecConstantFalse, Some(id)) = (constant.class.opcode, constant.result_id) {
            values.insert(id, u32::from(constant.class.opcode == Op::SpecConstantTrue));
        }
    }
    let parameters = function.parameters.iter().filter_map(|i| i.result_id);
    values.extend(parameters.zip(arguments.iter().copied()));
    let mut memory: HashMap<u32, u32> = HashMap::new();
    let (mut block, mut before) = (&function.blocks[0], None);
    loop {
        // Phis take their values all at once.
        let incoming = |i: &Instruction| {
            let pair = i.operands.chunks_exact(2).find(|pair| Some(id_of(&pair[1])) == before)?;
            Some((i.result_id?, values[&id_of(&pair[0])]))
        };
        let phis = block.instructions.iter().filter(|i| i.class.opcode == Op::Phi);
        let phis: Vec<_> = phis.map(|i| incoming(i).expect("a phi has a value of every block before")).collect();
        values.extend(phis);
        let mut next = None;
        for i in &block.instructions {
            let of = |place: usize| values[&id_of(&i.operands[place])];
            let result = match i.class.opcode {
                Op::IAdd => Some(of(0).wrapping_add(of(1))),
                Op::ULessThan => Some(u32::from(of(0) < of(1))),
                Op::Select => Some(of(if of(0) == 0 { 2 } else { 1 })),
                Op::Load => Some(memory[&id_of(&i.operands[0])]),
                Op::Store => {
                    memory.insert(id_of(&i.operands[0]), of(1));
                    None
                }
                Op::Branch => {
                    next = Some(id_of(&i.operands[0]));
                    None
                }
                Op::BranchConditional => {
                    next = Some(id_of(&i.operands[if of(0) == 0 { 2 } else { 1 }]));
                    None
                }
                Op::ReturnValue => return of(0),
                Op::Phi | Op::LoopMerge | Op::SelectionMerge | Op::Variable => None,
                other => panic!("{other:?} is in no small module"),
            };
            values.extend(result.map(|value| (i.result_id.expect("it has a result"), value)));
        }
        before = Some(label(block));
        let next = next.expect("a block ends in a branch");
        block = function.blocks.iter().find(|block| label(block) == next).expect("the function has the block");
    }
}

/// A function of floats that gives a float, of what `code` makes of its parameters.
pub fn float_function(
    b: &mut Builder,
    name: &str,
    parameters: usize,
    code: impl FnOnce(&mut Builder, u32, &[u32]) -> u32,
) -> u32 {
    let float = b.type_float(32, None);
    let of = b.type_function(float, vec![float; parameters]);
    let function = b.begin_function(float, None, FunctionControl::NONE, of).expect("functions do not nest");
    b.name(function, name);
    let values: Vec<u32> = (0..parameters).map(|_| b.function_parameter(float).expect("a function is open")).collect();
    b.begin_block(None).expect("blocks do not nest");
    let value = code(b, float, &values);
    b.ret_value(value).expect("a block is open");
    b.end_function().expect("a function is open");
    function
}
