// SPDX-License-Identifier: MIT
//
// The functions of the reduced model for one level. Compiled once for each level, like
// chain/motion.cpp.
#include "pipedyn/galerkin/kernel.hpp"

#include "pipedyn/galerkin/axial.hpp"
#include "pipedyn/galerkin/block.hpp"
#include "pipedyn/galerkin/linearisation.hpp"

namespace {

template <class Of>
Of placed(const GridTables& grid, const MotionEffects& effects) {
  Of block(grid, effects);
  laid_out([&](Layout& layout) { block.take(layout); });
  return block;
}

/// Calls body with the block for a batch: of one member or of as many as a pack holds.
template <template <class> class Of, class Body>
void with_block(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
                const Body& body) {
  if (batch.members == 1) {
    body(placed<Of<double>>(grid, effects));
  } else {
    body(placed<Of<Pack>>(grid, effects));
  }
}

void accelerations(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
                   double* out) {
  with_block<Block>(grid, effects, batch, [&](auto&& block) { block.accelerations(batch, out); });
}

void jacobian(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
              double* out) {
  with_block<Linearisation>(grid, effects, batch,
                            [&](auto&& block) { block.jacobian(batch, out); });
}

void operators(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
               const double* displacements, double* out) {
  placed<Linearisation<double>>(grid, effects).operators(batch, displacements, out);
}

void energy(const GridTables& grid, const MotionEffects& effects, const Batch& batch, double* out) {
  with_block<Block>(grid, effects, batch, [&](auto&& block) { store(out, block.energy(batch)); });
}

void power(const GridTables& grid, const MotionEffects& effects, const Batch& batch, double* out) {
  with_block<Block>(grid, effects, batch, [&](auto&& block) { block.power(batch, out); });
}

void axial(const GridTables& grid, const MotionEffects& effects, const Batch& batch, double* out) {
  with_block<Axial>(grid, effects, batch, [&](auto&& block) { block.axial(batch, out); });
}

void tips(const GridTables& grid, const MotionEffects& effects, const Batch& batch, double* out) {
  with_block<Block>(grid, effects, batch, [&](auto&& block) { block.tips(batch, out); });
}

void held(const GridTables& grid, const MotionEffects& effects, const Batch& batch, double* out) {
  with_block<Block>(grid, effects, batch, [&](auto&& block) { block.held(batch, out); });
}

}  // namespace

namespace pipedyn {

const GalerkinKernel PIPEDYN_NAMED(galerkin) = {
    .accelerations = ::accelerations,
    .energy = ::energy,
    .power = ::power,
    .axial = ::axial,
    .tips = ::tips,
    .held = ::held,
    .jacobian = ::jacobian,
    .operators = ::operators,
};

}  // namespace pipedyn
