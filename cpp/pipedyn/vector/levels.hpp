// SPDX-License-Identifier: MIT
//
// Vector levels: one source is compiled for several widths of vectors, and the widest one that the
// processor supports is used.
#pragma once

#include <string>
#include <vector>

#include "pipedyn/chain/motion.hpp"

namespace pipedyn {

/// Names of the levels that this processor can run, narrowest first.
std::vector<std::string> vector_levels();

/// Name of the level in use: the widest, or the one that the environment variable
/// PIPEDYN_VECTOR_LEVEL names, until set_vector_level is called.
std::string vector_level();

/// Chooses the level, for tests and measurements. Throws std::invalid_argument unless
/// vector_levels() contains the name.
void set_vector_level(const std::string& name);

/// Functions that are compiled for the level in use.
const MotionKernel& motion_kernel();

}  // namespace pipedyn
