// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

namespace pipedyn {

/// At least count numbers of the thread, on the boundary of the widest vector; the thread's next
/// call may overwrite or move them. Defined in levels.cpp, so that no vector level compiles it.
double* scratch(std::ptrdiff_t count);

}  // namespace pipedyn
