// The value of a result, for commands: an error becomes the exception that main prints as one line.
#pragma once

#include <stdexcept>
#include <utility>

#include "rt/result.hpp"

namespace teletact {

// Throws std::runtime_error with the result's own line.
template <class T>
T take(rt::Result<T> result) {
  if (!result) throw std::runtime_error(result.error());
  return std::move(result).value();
}

}  // namespace teletact
