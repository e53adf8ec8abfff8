#include "tools/scene/page_hook.hpp"

#include <utility>

#include "tools/scene/box_devices.hpp"

namespace teletact {

void put_page_hand(rt::NonRealtime& nrt, PageHook* page, BoxOptions& options) {
  if (page == nullptr) return;
  options.wrap_device = [&nrt, page,
                         outer = std::move(options.wrap_device)](drivers::HapticDevice& device) {
    drivers::HapticDevice* hand = page->hand_over(nrt, device);
    return outer ? outer(*hand) : hand;
  };
}

}  // namespace teletact
