/* The radio model `link`: what is received, despread, decoded and heard; see fpg_bench/game/link.py.
   rules.radio: the numbers of state.RADIO. Powers in mW, widths in MHz; [i] is unspread or, while spreading, spread. */
"use strict";
const fpgLink = (() => {
  const { PURPOSE, gaussians } = fpgDraws;
  const { distance } = fpgFlight;
  const DB = 10 / Math.LN10, ROOM_MHZ = 1e-6;
  const ratio = (db) => Math.exp(db / DB);
  const between = (x, low, high) => Math.min(Math.max(x, low), high);

  function received(powerMw, metres, mhz, rules) {
    const product = Math.max(metres, rules.minimum_distance) * mhz;
    return (powerMw * rules.radio.path_gain) / (product * product);
  }

  /** The integral of the receive filter, a raised cosine, from its centre. */
  function passed(offset, width, rolloff) {
    const away = Math.abs(offset), flat = 0.5 * (1 - rolloff) * width;
    if (away <= flat) return offset;
    const skirt = rolloff * width, x = away - flat;
    const most = away < flat + skirt ? flat + 0.5 * x + (skirt / (2 * Math.PI)) * Math.sin((Math.PI * x) / skirt) : 0.5 * width;
    return Math.sign(offset) * most;
  }

  /** The integral of its square. */
  function passedTwice(offset, width, rolloff) {
    const away = Math.abs(offset), flat = 0.5 * (1 - rolloff) * width;
    if (away <= flat) return offset;
    const skirt = rolloff * width, x = Math.min(away - flat, skirt), angle = (Math.PI * x) / skirt;
    return Math.sign(offset) * (flat + 0.375 * x + (skirt / Math.PI) * (0.5 * Math.sin(angle) + 0.0625 * Math.sin(2 * angle)));
  }

  /** The first tooth of a comb in the band and the one after its last, counted from the centre. */
  function teeth(type, mhz, rules) {
    const spacing = rules.tooth_spacing[type];
    if (spacing === 0) return [0, 1];
    const first = Math.ceil((rules.band_low - ROOM_MHZ - mhz) / spacing);
    return [first, Math.max(Math.floor((rules.band_high + ROOM_MHZ - mhz) / spacing), first) + 1];
  }

  /** Whether a footprint covers the ally's channel; no tooth lies outside the band. */
  function covers(type, centre, mhz, spreading, rules) {
    const spacing = rules.tooth_spacing[type];
    let offset = mhz - centre;
    if (spacing > 0) {
      const [first, end] = teeth(type, centre, rules);
      offset -= spacing * between(Math.floor(offset / spacing + 0.5), first, end - 1);
    }
    return Math.abs(offset) <= rules.half_width[type] + rules.radio.reach[Number(spreading)];
  }

  /** The share of the jamming that passes the ally's filter, that of a tooth per MHz, and where most of it passes. */
  function jammingPassed(game, rules) {
    const { radio } = rules, width = radio.channel_width[Number(game.spreading)], tooth = radio.tooth_width[game.type];
    const [first, end] = teeth(game.type, game.centre, rules), offset = game.centre - game.frequency;
    let sum = 0, most = -1, densest = offset;
    for (let number = first; number < end; number++) {
      const centre = offset + number * rules.tooth_spacing[game.type];
      const part = passed(centre + 0.5 * tooth, width, radio.rolloff) - passed(centre - 0.5 * tooth, width, radio.rolloff);
      sum += part;
      if (part > most) [most, densest] = [part, centre];
    }
    const density = 1 / (tooth * (end - first));
    return [sum * density, density, densest];
  }

  /** What a notch removes of the signal, the echoes it makes, and what it removes of the jamming. */
  function notched(toothMhz, density, centre, radio) {
    const width = radio.channel_width[1], { rolloff } = radio, half = 0.5 * radio.notch_width, tooth = 0.5 * toothMhz;
    const room = Math.max(tooth - half, 0), place = between(0, centre - room, centre + room);
    const share = (of, low, high) => of(high, width, rolloff) - of(low, width, rolloff);
    const cut = share(passed, place - half, place + half) / width;
    const inTooth = share(passed, Math.max(place - half, centre - tooth), Math.min(place + half, centre + tooth));
    return [cut, share(passedTwice, place - half, place + half) / width - cut * cut, density * inTooth];
  }

  function sinr(signal, jamming, share, [cut, echoes, removed], i, radio) {
    const through = share + radio.stopband;
    const plain = signal / (radio.noise_mw[i] + jamming * through * radio.per_gain[i]);
    if (cut === 0) return plain;
    const kept = 1 - cut, noise = kept * radio.noise_mw[i] + (echoes * signal + jamming * (through - removed)) * radio.per_gain[i];
    return Math.max(plain, (kept * kept * signal) / noise);
  }

  /** The SNR of the step, with and without jamming. */
  function transmit(game, rules) {
    const { radio } = rules, i = Number(game.spreading), mhz = game.frequency;
    const signal = received(radio.base_mw, distance(game.ally, rules.base_station), mhz, rules) * ratio(rules.fading_sd * game.fading);
    game.snr = game.cleanSnr = DB * Math.log(signal / radio.noise_mw[i]);
    if (game.type < 0) return;
    const jamming = received(radio.jamming_mw[game.type], game.distance, mhz, rules) * ratio(radio.jamming_fading_sd * game.jammingFading);
    const [share, density, centre] = jammingPassed(game, rules);
    const notch = game.spreading && radio.notch_width > 0 ? notched(radio.tooth_width[game.type], density, centre, radio) : [0, 0, 0];
    game.snr = DB * Math.log(sinr(signal, jamming, share, notch, i, radio));
  }

  /** Fading of both paths: each end that moves decorrelates them. */
  function fade(game, drawn, rules) {
    const kept = Math.exp(-game.speed * rules.radio.per_fading_distance), other = kept * Math.exp(-game.flown * rules.radio.per_fading_distance);
    const [jammed] = gaussians(game.key, game.step, PURPOSE.jammingFading);
    game.fading = kept * game.fading + Math.sqrt(1 - kept * kept) * drawn;
    game.jammingFading = other * game.jammingFading + Math.sqrt(1 - other * other) * jammed;
  }

  /** The ally moves to where its spread signal fits, and hops and changes of the waveform take airtime. */
  function tune(game, before, spread, rules) {
    const { radio } = rules;
    if (spread) game.point = between(game.point, ...radio.spread_points);
    game.frequency = fpgRules.pointMhz(game.point, rules);
    const moved = game.hopped || game.point !== before;
    game.airtime = 1 - (moved ? radio.hop_airtime : 0);
  }

  function rate(snr, i, rules) {
    const { radio } = rules;
    if (snr < rules.threshold) return 0;
    return radio.rate_bandwidth[i] * Math.min(radio.rate_efficiency * Math.log2(1 + ratio(snr - radio.rate_loss)), radio.rate_top);
  }

  const utility = (mbit, radio) => radio.reward_scale * Math.log1p(mbit * radio.per_rate_reference);

  /** A rotary wing's power in level flight, in W; see flight.py. */
  function flightW(speed) {
    const square = speed * speed, half = square / (2 * 4.03 * 4.03);
    return 79.8563 * (1 + (3 * square) / (120 * 120)) + 88.6279 * Math.sqrt(Math.sqrt(1 + half * half) - half) + 0.5 * 0.6 * 1.225 * 0.05 * 0.503 * square * speed;
  }

  function reward(game, costs, near, rules) {
    const { radio } = rules, i = Number(game.spreading);
    const [value, clean] = [game.snr, game.cleanSnr].map((snr) => utility(rate(snr, i, rules), radio));
    const looked = game.step + 1 === game.nextCheck ? radio.look_through * (clean - value) : 0;
    game.allyReward = game.airtime * (value + looked) - costs - radio.flight_cost_per_w * (flightW(game.speed) - radio.least_power);
    game.opponentReward = near + rules.snr_drop_weight * game.airtime * (clean - value - looked);
  }

  /** The base station's radiation towards the opponent, as a share of that along its beam to the ally. */
  function beam(game, { base_station: base, radio }) {
    const [to, away] = [game.ally, game.opponent].map((place) => place.map((x, axis) => x - base[axis]));
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const angle = Math.acos(between(dot(to, away) / Math.sqrt(Math.max(dot(to, to) * dot(away, away), 1e-12)), -1, 1)) * radio.per_beam;
    return Math.max(ratio(-12 * angle * angle), radio.side_lobe);
  }

  /** Whether the opponent's radiometer hears the ally, or the base station that answers it. */
  function hears(game, rules) {
    const { radio } = rules, i = Number(game.spreading), mhz = game.frequency;
    const leaked = radio.look_through > 0 ? 0 : radio.own_jamming_mw[game.type] * (jammingPassed(game, rules)[0] + radio.stopband);
    const ally = received(radio.ally_emission_mw, game.distance, mhz, rules);
    const base = received(radio.base_mw * beam(game, rules), distance(game.opponent, rules.base_station), mhz, rules);
    const [fading] = gaussians(game.key, game.step, PURPOSE.detection);
    return Math.max(ally, base) * ratio(rules.fading_sd * fading) >= radio.radiometer_threshold * (radio.channel_noise_mw[i] + leaked);
  }

  return { covers, transmit, fade, tune, reward, hears };
})();
