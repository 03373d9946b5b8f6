// SPDX-License-Identifier: MIT
//
// One source compiled for several widths of vectors; the widest that the processor has answers.
#pragma once

#include <string>
#include <vector>

#include "pipedyn/chain/motion.hpp"

namespace pipedyn {

/// Names of the levels that this processor can run, narrowest first.
std::vector<std::string> vector_levels();

/// The level in use: at first the widest, or the one that the environment variable
/// PIPEDYN_VECTOR_LEVEL names.
std::string vector_level();

/// For tests and measurements. Throws std::invalid_argument unless vector_levels() has the name.
void set_vector_level(const std::string& name);

/// What answers at the level in use.
const MotionKernel& motion_kernel();

}  // namespace pipedyn
