// A click of an operator on an image: this pixel is of the object, or it is not.
#pragma once

namespace perception {

struct Click {
  int u = 0, v = 0;  // pixel of the full image
  bool add = true;   // else take away
};

}  // namespace perception
