// The page against a twin of the box, in a real browser: page_test.mjs SITE ARTEFACTS. Prints its
// seed; TELETACT_SEED repeats a run. 77: no browser here. In the order of these lines.
import './quantiles';
import './readers';
import './held';
import './key_meanings';
import './picture_age';
import './picture_hit';
import './drawing';
import './selecting';
import './picture_shown';
import './acts';
import './sessions';
import './lapses';
import './panels';
import './keyboards';
import './pads';
import './sizes';
import './tunnel';
import './headset';
