//! What is left of a kernel once its specialization constants are known: the code that can run, and what that code uses.
//!
//! Drivers drop what a constant rules out, but only after they have read, validated and translated all of it, and a
//! buffer that only such code uses must still be bound: to Vulkan it is part of the kernel. A kernel has code for every
//! material there is, and most scenes have two: nine tenths of it go here, and so does the time that a driver takes.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Block, Function, Instruction, Module, Operand};
use rspirv::spirv::{BuiltIn, Capability, Decoration, Op, StorageClass};

use crate::ids::{decorations, id_of, label};

/// Takes out what cannot run under those constants (by id; others keep their own value), and what is of no use then.
/// What remains computes the same, and still has the constants that it reads.
pub fn prune(module: &mut Module, constants: &[u32]) {
    let (live, values) = live_blocks(module, constants);
    for function in &mut module.functions {
        cut_branches(function, &live, &values);
    }
    let same = known_results(module, &values);
    for instruction in module.functions.iter_mut().flat_map(|f| &mut f.blocks).flat_map(|b| &mut b.instructions) {
        for operand in &mut instruction.operands {
            if let Operand::IdRef(id) = operand {
                while let Some(other) = same.get(id) {
                    *id = *other;
                }
            }
        }
    }
    remove_unused(module);
}

/// Labels of the blocks that can run, and the ids whose values are known: 32-bit words, and booleans as 0 and 1.
///
/// Whole functions at first; what is then known of conditions takes blocks away, and what remains
/// makes more conditions known.
fn live_blocks(module: &Module, constants: &[u32]) -> (HashSet<u32>, HashMap<u32, u32>) {
    let globals = global_values(module, constants);
    let mut live: HashSet<u32> = module.functions.iter().flat_map(|function| &function.blocks).map(label).collect();
    loop {
        let mut values = globals.clone();
        let mut reached = HashSet::new();
        for function in &module.functions {
            for block in function.blocks.iter().filter(|block| live.contains(&label(block))) {
                for instruction in &block.instructions {
                    if let (Some(id), Some(value)) = (instruction.result_id, evaluate(instruction, &values, &live)) {
                        values.insert(id, value);
                    }
                }
            }
            let blocks: HashMap<u32, &Block> = function.blocks.iter().map(|block| (label(block), block)).collect();
            let mut waiting: Vec<u32> = function.blocks.iter().take(1).map(label).collect();
            while let Some(next) = waiting.pop() {
                if reached.insert(next) {
                    waiting.extend(successors(blocks[&next], &values));
                }
            }
        }
        if reached == live {
            return (live, values);
        }
        live = reached;
    }
}

/// Constants by id. Those that are not set keep their own value.
fn global_values(module: &Module, constants: &[u32]) -> HashMap<u32, u32> {
    let ids = decorations(module, Decoration::SpecId);
    let mut values = HashMap::new();
    for instruction in &module.types_global_values {
        let Some(id) = instruction.result_id else { continue };
        let set = ids.get(&id).and_then(|place| constants.get(*place as usize)).copied();
        let value = match (instruction.class.opcode, instruction.operands.first()) {
            (Op::ConstantTrue, _) => Some(1),
            (Op::ConstantFalse, _) => Some(0),
            (Op::SpecConstantTrue, _) => Some(set.map_or(1, |value| u32::from(value != 0))),
            (Op::SpecConstantFalse, _) => Some(set.map_or(0, |value| u32::from(value != 0))),
            (Op::Constant, Some(Operand::LiteralBit32(word))) => Some(*word),
            (Op::SpecConstant, Some(Operand::LiteralBit32(word))) => Some(set.unwrap_or(*word)),
            (Op::SpecConstantOp, Some(Operand::LiteralSpecConstantOpInteger(op))) => {
                fold(*op, &known(&instruction.operands[1..], &values))
            }
            _ => None,
        };
        values.extend(value.map(|value| (id, value)));
    }
    values
}

/// The value of each operand, as far as it is known.
fn known(operands: &[Operand], values: &HashMap<u32, u32>) -> Vec<Option<u32>> {
    operands.iter().map(|operand| values.get(&operand.id_ref_any()?).copied()).collect()
}

fn evaluate(instruction: &Instruction, values: &HashMap<u32, u32>, live: &HashSet<u32>) -> Option<u32> {
    if instruction.class.opcode != Op::Phi {
        return fold(instruction.class.opcode, &known(&instruction.operands, values));
    }
    // One value, whichever block came before.
    let pairs = instruction.operands.chunks_exact(2);
    let mut incoming = pairs.filter(|pair| pair[1].id_ref_any().is_some_and(|from| live.contains(&from)));
    let first = values.get(&incoming.next()?[0].id_ref_any()?)?;
    incoming.all(|pair| pair[0].id_ref_any().and_then(|id| values.get(&id)) == Some(first)).then_some(*first)
}

/// The result of an operation on what is known of its operands: the operations that conditions on
/// constants are made of.
fn fold(op: Op, operands: &[Option<u32>]) -> Option<u32> {
    let truth = |value: bool| Some(u32::from(value));
    match (op, operands) {
        (Op::LogicalAnd, [Some(0), _] | [_, Some(0)]) => Some(0),
        (Op::LogicalOr, [Some(1), _] | [_, Some(1)]) => Some(1),
        (Op::LogicalAnd, [Some(a), Some(b)]) => Some(a & b),
        (Op::LogicalOr, [Some(a), Some(b)]) => Some(a | b),
        (Op::LogicalNot, [Some(a)]) => truth(*a == 0),
        (Op::IEqual | Op::LogicalEqual, [Some(a), Some(b)]) => truth(a == b),
        (Op::INotEqual | Op::LogicalNotEqual, [Some(a), Some(b)]) => truth(a != b),
        (Op::UGreaterThan, [Some(a), Some(b)]) => truth(a > b),
        (Op::ULessThan, [Some(a), Some(b)]) => truth(a < b),
        (Op::UGreaterThanEqual, [Some(a), Some(b)]) => truth(a >= b),
        (Op::ULessThanEqual, [Some(a), Some(b)]) => truth(a <= b),
        (Op::Select, [Some(condition), a, b]) => *if *condition != 0 { a } else { b },
        _ => None,
    }
}

/// Blocks that may run after a block.
fn successors(block: &Block, values: &HashMap<u32, u32>) -> Vec<u32> {
    let Some(end) = block.instructions.last() else { return Vec::new() };
    if let Some(target) = only_target(end, values) {
        return vec![target];
    }
    let targets = match end.class.opcode {
        Op::BranchConditional | Op::Switch => &end.operands[1..],
        Op::Branch => &end.operands[..],
        _ => &[],
    };
    targets.iter().filter_map(Operand::id_ref_any).collect()
}

/// Where a conditional branch goes, if its condition is known.
fn only_target(end: &Instruction, values: &HashMap<u32, u32>) -> Option<u32> {
    let (Op::BranchConditional, [condition, yes, no, ..]) = (end.class.opcode, &end.operands[..]) else { return None };
    let condition = values.get(&id_of(condition))?;
    Some(id_of(if *condition != 0 { yes } else { no }))
}

/// Leaves of a function the blocks that can run, with branches only where something is to be decided.
///
/// A merge or a continue block must be there even if nothing gets to it, as long as its header is.
fn cut_branches(function: &mut Function, live: &HashSet<u32>, values: &HashMap<u32, u32>) {
    function.blocks.iter_mut().filter(|block| live.contains(&label(block))).for_each(|block| decide(block, values));

    let mut headers = HashMap::new();
    let mut merges = HashSet::new();
    for block in function.blocks.iter().filter(|block| live.contains(&label(block))) {
        for merge in block.instructions.iter().filter(|i| is_merge(i)) {
            merges.insert(id_of(&merge.operands[0]));
            if merge.class.opcode == Op::LoopMerge {
                headers.insert(id_of(&merge.operands[1]), label(block));
            }
        }
    }
    function.blocks.retain_mut(|block| {
        let name = label(block);
        if live.contains(&name) {
            return true;
        }
        let end = match headers.get(&name) {
            Some(header) => branch(*header),
            None => Instruction::new(Op::Unreachable, None, None, Vec::new()),
        };
        block.instructions = vec![end];
        headers.contains_key(&name) || merges.contains(&name)
    });

    let mut before: HashMap<u32, HashSet<u32>> = HashMap::new();
    for block in &function.blocks {
        for next in successors(block, &HashMap::new()) {
            before.entry(next).or_default().insert(label(block));
        }
    }
    for block in &mut function.blocks {
        let Some(before) = before.get(&label(block)) else { continue };
        for phi in block.instructions.iter_mut().filter(|i| i.class.opcode == Op::Phi) {
            let mut missing = before.clone();
            let mut kept = Vec::new();
            for pair in phi.operands.chunks_exact(2).filter(|pair| before.contains(&id_of(&pair[1]))) {
                let from = id_of(&pair[1]);
                if live.contains(&from) {
                    missing.remove(&from);
                    kept.extend_from_slice(pair);
                }
            }
            // From a continue block that nothing gets to comes whatever was there.
            let itself = phi.result_id.expect("a phi has a result");
            kept.extend(missing.into_iter().flat_map(|from| [itself, from].map(Operand::IdRef)));
            phi.operands = kept;
        }
    }
}

fn branch(target: u32) -> Instruction {
    Instruction::new(Op::Branch, None, None, vec![Operand::IdRef(target)])
}

fn is_merge(instruction: &Instruction) -> bool {
    matches!(instruction.class.opcode, Op::SelectionMerge | Op::LoopMerge)
}

/// Ends a block by where it goes, if that is known. A selection of one side is none, nor is a loop that is not entered.
fn decide(block: &mut Block, values: &HashMap<u32, u32>) {
    let Some(target) = block.instructions.last().and_then(|end| only_target(end, values)) else { return };
    block.instructions.pop();
    block.instructions.push(branch(target));
    block.instructions.retain(|i| match i.class.opcode {
        Op::SelectionMerge => false,
        Op::LoopMerge => id_of(&i.operands[0]) != target,
        _ => true,
    });
}

/// Results that are another id's: of selections whose condition is known, and of phis that have one way to come.
fn known_results(module: &Module, values: &HashMap<u32, u32>) -> HashMap<u32, u32> {
    let same = |i: &Instruction| {
        let other = match (i.class.opcode, &i.operands[..]) {
            (Op::Select, [condition, yes, no]) => {
                if *values.get(&id_of(condition))? != 0 {
                    yes
                } else {
                    no
                }
            }
            (Op::Phi, [value, _]) => value,
            _ => return None,
        };
        Some((i.result_id?, id_of(other)))
    };
    module.functions.iter().flat_map(|f| &f.blocks).flat_map(|b| &b.instructions).filter_map(same).collect()
}

/// What code that can run needs of a module.
struct Needed<'a> {
    /// What defines an id, in functions and out of them.
    definitions: HashMap<u32, &'a Instruction>,
    /// What is stored in each variable that only this invocation sees.
    stores: HashMap<u32, Vec<&'a Instruction>>,
    ids: HashSet<u32>,
    waiting: Vec<u32>,
}

impl Needed<'_> {
    fn add(&mut self, id: u32) {
        if self.ids.insert(id) {
            self.waiting.push(id);
        }
    }

    fn add_all_of(&mut self, instruction: &Instruction) {
        let operands = instruction.operands.iter().filter_map(Operand::id_ref_any);
        operands.chain(instruction.result_type).for_each(|id| self.add(id));
    }

    fn follow(&mut self) {
        while let Some(id) = self.waiting.pop() {
            if let Some(definition) = self.definitions.get(&id).copied() {
                self.add_all_of(definition);
            }
            // Somebody reads it.
            self.stores.remove(&id).into_iter().flatten().for_each(|store| self.add_all_of(store));
        }
    }
}

/// Whether an instruction does something beside giving a result.
fn has_effect(instruction: &Instruction) -> bool {
    let class = instruction.class;
    instruction.result_id.is_none() || class.opcode == Op::FunctionCall || class.opname.starts_with("Atomic")
}

/// Variables that only one invocation sees, each under its own id and those of pointers into it.
fn own_variables(module: &Module) -> HashMap<u32, u32> {
    let mut variables = HashMap::new();
    let code = module.functions.iter().flat_map(|f| &f.blocks).flat_map(|b| &b.instructions);
    for instruction in module.types_global_values.iter().chain(code) {
        let Some(id) = instruction.result_id else { continue };
        match (instruction.class.opcode, &instruction.operands[..]) {
            (Op::Variable, [Operand::StorageClass(StorageClass::Function | StorageClass::Private), ..]) => {
                variables.insert(id, id);
            }
            (Op::AccessChain | Op::InBoundsAccessChain, [base, ..]) => {
                variables.extend(variables.get(&id_of(base)).copied().map(|variable| (id, variable)));
            }
            _ => {}
        }
    }
    variables
}

/// Removes what nothing needs: results that nobody uses, variables that nobody reads, and what is declared for them.
fn remove_unused(module: &mut Module) {
    let own = own_variables(module);
    let stored_in = |i: &Instruction| {
        let is_store = i.class.opcode == Op::Store;
        is_store.then(|| own.get(&id_of(&i.operands[0])).copied()).flatten()
    };
    let blocks = || module.functions.iter().flat_map(|function| &function.blocks);
    let code = || blocks().flat_map(|block| &block.instructions);
    let definitions = module.types_global_values.iter().chain(code()).filter_map(|i| Some((i.result_id?, i)));
    let mut needed =
        Needed { definitions: definitions.collect(), stores: HashMap::new(), ids: HashSet::new(), waiting: Vec::new() };
    for instruction in code() {
        match stored_in(instruction) {
            Some(variable) => needed.stores.entry(variable).or_default().push(instruction),
            None if has_effect(instruction) => needed.add_all_of(instruction),
            None => {}
        }
    }
    for function in &module.functions {
        function.def.iter().chain(&function.parameters).for_each(|i| needed.add_all_of(i));
    }
    module.execution_modes.iter().for_each(|mode| needed.add_all_of(mode));
    // The size of a workgroup is a constant that has this name and that nothing need refer to.
    let size = |i: &&Instruction| i.operands.get(2) == Some(&Operand::BuiltIn(BuiltIn::WorkgroupSize));
    module.annotations.iter().filter(size).for_each(|i| needed.add_all_of(i));
    needed.follow();
    let ids = needed.ids;

    for block in module.functions.iter_mut().flat_map(|function| &mut function.blocks) {
        block.instructions.retain(|i| match stored_in(i) {
            Some(variable) => ids.contains(&variable),
            None => has_effect(i) || i.result_id.is_some_and(|id| ids.contains(&id)),
        });
    }
    module.types_global_values.retain(|i| i.result_id.is_none_or(|id| ids.contains(&id)));
    for entry in &mut module.entry_points {
        // The function, its name, and the variables that it may use.
        let mut place = 0;
        entry.operands.retain(|operand| {
            place += 1;
            place <= 3 || operand.id_ref_any().is_none_or(|id| ids.contains(&id))
        });
    }
    let defined: HashSet<u32> = module.all_inst_iter().filter_map(|i| i.result_id).collect();
    let is_of_nothing = |i: &Instruction| i.operands[0].id_ref_any().is_some_and(|id| !defined.contains(&id));
    module.annotations.retain(|i| !is_of_nothing(i));
    module.debug_names.retain(|i| !is_of_nothing(i));
    forget_subgroups(module);
}

/// Withdraws the demand for subgroup operations of a kernel that has none any more.
fn forget_subgroups(module: &mut Module) {
    let is_of_subgroups = |i: &Instruction| {
        let is_known_by_it = |operand: &Operand| {
            use BuiltIn::{NumSubgroups, SubgroupId, SubgroupLocalInvocationId, SubgroupSize};
            matches!(operand, Operand::BuiltIn(NumSubgroups | SubgroupId | SubgroupLocalInvocationId | SubgroupSize))
        };
        i.class.opname.starts_with("GroupNonUniform") || i.operands.iter().any(is_known_by_it)
    };
    if module.all_inst_iter().any(is_of_subgroups) {
        return;
    }
    module.capabilities.retain(|i| {
        !matches!(
            i.operands[0],
            Operand::Capability(
                Capability::GroupNonUniform
                    | Capability::GroupNonUniformVote
                    | Capability::GroupNonUniformArithmetic
                    | Capability::GroupNonUniformBallot
            )
        )
    });
}

#[cfg(test)]
mod tests {
    use rspirv::dr::Builder;
    use rspirv::spirv::{FunctionControl, LoopControl, SelectionControl};

    use super::*;
    use crate::small;

    /// Ways that a specialization constant decides, in [`looping`].
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Way {
        /// Which side of an `if` in the loop runs.
        Side,
        /// Whether the loop is entered.
        Entry,
        /// Whether the loop ends in its first turn.
        End,
    }

    /// `uint f(uint n)`, with a loop of `n` turns, in each of which `sum` grows by one or two, and a constant that decides.
    fn looping(way: Way, constant: bool) -> Module {
        let mut b = small::builder();
        let (uint, truth) = (b.type_int(32, 0), b.type_bool());
        let of = b.type_function(uint, [uint]);
        let [zero, one, two] = [0, 1, 2].map(|value| b.constant_bit32(uint, value));
        let decides = if constant { b.spec_constant_true(truth) } else { b.spec_constant_false(truth) };
        let pointer = b.type_pointer(None, StorageClass::Function, uint);
        b.begin_function(uint, None, FunctionControl::NONE, of).expect("functions do not nest");
        let n = b.function_parameter(uint).expect("a function is open");
        let entry = b.begin_block(None).expect("blocks do not nest");
        // Of which nobody reads the second.
        let [sum, unread] = [(); 2].map(|()| b.variable(pointer, None, StorageClass::Function, None));
        let open = "a block is open";
        b.store(sum, zero, None, []).expect(open);
        b.store(unread, n, None, []).expect(open);
        let [head, test, body, left, right, joined, last, next, end, stepped] = [(); 10].map(|()| b.id());
        b.branch(head).expect(open);
        b.begin_block(Some(head)).expect("blocks do not nest");
        let i = b.phi(uint, None, [(zero, entry), (stepped, next)]).expect(open);
        b.loop_merge(end, next, LoopControl::NONE, []).expect(open);
        if way == Way::Entry {
            b.branch_conditional(decides, test, end, []).expect(open);
        } else {
            b.branch(test).expect(open);
        }
        b.begin_block(Some(test)).expect("blocks do not nest");
        let goes_on = b.u_less_than(truth, None, i, n).expect(open);
        b.branch_conditional(goes_on, body, end, []).expect(open);
        b.begin_block(Some(body)).expect("blocks do not nest");
        b.selection_merge(joined, SelectionControl::NONE).expect(open);
        let side = if way == Way::Side { decides } else { b.u_less_than(truth, None, i, two).expect(open) };
        b.branch_conditional(side, left, right, []).expect(open);
        let grown = [(left, one), (right, two)].map(|(block, by)| {
            b.begin_block(Some(block)).expect("blocks do not nest");
            let before = b.load(uint, None, sum, None, []).expect(open);
            let after = b.i_add(uint, None, before, by).expect(open);
            b.branch(joined).expect(open);
            (after, block)
        });
        b.begin_block(Some(joined)).expect("blocks do not nest");
        let grown = b.phi(uint, None, grown).expect(open);
        let by_choice = b.i_add(uint, None, grown, one).expect(open);
        let chosen = b.select(uint, None, decides, grown, by_choice).expect(open);
        b.store(sum, chosen, None, []).expect(open);
        if way == Way::End {
            b.branch_conditional(decides, end, last, []).expect(open);
        } else {
            b.branch(last).expect(open);
        }
        b.begin_block(Some(last)).expect("blocks do not nest");
        b.i_add(uint, Some(stepped), i, one).expect(open);
        b.branch(next).expect(open);
        b.begin_block(Some(next)).expect("blocks do not nest");
        b.branch(head).expect(open);
        b.begin_block(Some(end)).expect("blocks do not nest");
        let result = b.load(uint, None, sum, None, []).expect(open);
        b.ret_value(result).expect(open);
        b.end_function().expect("a function is open");
        b.module()
    }

    fn count(module: &Module, op: Op) -> usize {
        module.all_inst_iter().filter(|i| i.class.opcode == op).count()
    }

    #[test]
    fn what_is_left_computes_the_same() {
        for way in [Way::Side, Way::Entry, Way::End] {
            for constant in [false, true] {
                let before = looping(way, constant);
                let mut after = before.clone();
                prune(&mut after, &[]);
                for n in 0..6 {
                    let [before, after] = [&before, &after].map(|module| small::run(module, &[n]));
                    assert_eq!(after, before, "{way:?} {constant}, {n}");
                }
                assert_eq!(count(&after, Op::Select), 0, "what it chooses is known");
                assert_eq!(count(&after, Op::Variable), usize::from(count(&after, Op::Load) > 0));
            }
        }
    }

    #[test]
    fn only_decisions_are_branches() {
        let pruned = |way, constant| {
            let mut module = looping(way, constant);
            prune(&mut module, &[]);
            module
        };
        for constant in [false, true] {
            let one_side = pruned(Way::Side, constant);
            assert_eq!([Op::SelectionMerge, Op::BranchConditional].map(|op| count(&one_side, op)), [0, 1]);
            assert_eq!(count(&one_side, Op::SpecConstantTrue) + count(&one_side, Op::SpecConstantFalse), 0);
        }
        let never_entered = pruned(Way::Entry, false);
        assert_eq!([Op::LoopMerge, Op::BranchConditional, Op::Phi].map(|op| count(&never_entered, op)), [0, 0, 0]);
        // The loop still has a continue block, which nothing gets to. In the only turn one side is known to run.
        let one_turn = pruned(Way::End, true);
        assert_eq!([Op::LoopMerge, Op::IAdd].map(|op| count(&one_turn, op)), [1, 1]);
    }

    #[test]
    fn subgroups_are_asked_for_by_kernels_that_use_them() {
        for used in [false, true] {
            let mut b = small::builder();
            b.capability(Capability::GroupNonUniform);
            let truth = b.type_bool();
            let uint = b.type_int(32, 0);
            let [one, two, subgroup] = [1, 2, 3].map(|value| b.constant_bit32(uint, value));
            let hits = small::buffer(&mut b, "hits", 0, 0);
            let constant = if used { b.spec_constant_true(truth) } else { b.spec_constant_false(truth) };
            small::main(&mut b, |b| {
                small::under(b, constant, |b: &mut Builder| {
                    let elected = b.group_non_uniform_elect(truth, None, subgroup).expect("a block is open");
                    let value = b.select(uint, None, elected, one, two).expect("a block is open");
                    let first = small::first_of(b, hits);
                    b.store(first, value, None, []).expect("a block is open");
                });
            });
            let mut module = b.module();
            prune(&mut module, &[]);
            let asked = |i: &Instruction| i.operands[0] == Operand::Capability(Capability::GroupNonUniform);
            assert_eq!(module.capabilities.iter().any(asked), used);
        }
    }
}
