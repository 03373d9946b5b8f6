// SPDX-License-Identifier: MIT
//
// An elastic foundation all along the pipe (Winkler): the law of a spring, per length.
#pragma once

#include "pipedyn/terms/spring.hpp"

namespace {

struct Foundation : Spring {
  static constexpr const char* name = "foundation";
  static constexpr bool along = true;
  using Spring::Spring;
};

}  // namespace
