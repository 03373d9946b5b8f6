// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

namespace pipedyn {

/// Memory of the thread for at least `count` numbers, aligned for the widest vector. The next call
/// in this thread may overwrite or move it. It is defined in levels.cpp, so that no vector level
/// compiles it.
double* scratch(std::ptrdiff_t count);

}  // namespace pipedyn
