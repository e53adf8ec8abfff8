// The page in a real browser against the real box: real_test.mjs SITE ARTEFACTS TELETACT SCENE
// [replays]. Prints its seed; TELETACT_SEED repeats a run. 77: no browser here. In the order of
// these lines.
import './real_acts';
import './real_drive';
import './real_keys';
import './real_replay';
