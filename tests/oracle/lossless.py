"""Plain decoder of lossless columns on Python's integers, written from docs/format.md."""

import math

from oracle.range_coder import Decoder

NEAR_BOUNDS = [0, 4, 8, 12, 16, 24, 32, 40, 56, 72, 96, 128, 192, 320, 640, 1280]
EXACT_BOUNDS = [0] + [2**i for i in range(15)]
LOGISTIC = [0] + [round(65536 / (1 + math.exp(-i / 64))) for i in range(-1023, 1024)] + [65536]


def clip(value, limit):
    return max(-limit, min(value, limit))


def half_octaves(value):
    digits = max(value.bit_length() - 1, 0)
    return 2 * digits + (digits > 0 and value >> (digits - 1) & 1)


def signed64(value):
    return (value + 2**63) % 2**64 - 2**63


class Cell:
    def __init__(self, p=2**19):
        self.p, self.count = p, 0

    def learn(self, bit):
        rate = round(65536 / (self.count + 1.6))
        self.p = min(max(self.p + ((bit * 2**20 - self.p) * rate >> 16), 64), 2**20 - 64)
        self.count = min(self.count + 1, 250)


def logit(p):
    middle = ((p >> 8) + 0.5) / 4096
    return round(256 * math.log(middle / (1 - middle)))


def log_ratio(above, below):
    return round(256 * math.log(above + 1)) - round(256 * math.log(below + 1))


class Mixture:
    """Cells by context and slot, weights by set."""

    def __init__(self, coder):
        self.coder, self.cells, self.sets = coder, {}, {}
        self.exponents = [Cell() for _ in range(62)]

    def bit(self, p):
        bit = int(self.coder.decode_cumulative(65536) < p)
        self.coder.interval(0 if bit else p, p if bit else 65536 - p, 65536)
        return bit

    def decide(self, row, ratio, slots, guide_ratio=None):
        """Inputs are the ratio, that of a guide, and a cell for each context."""
        weights, uses = self.sets.setdefault(row, ([39322] + [16384] * 5, [0]))
        cells = [self.cells.setdefault(slot, Cell()) for slot in slots]
        inputs = [ratio, *([] if guide_ratio is None else [guide_ratio])]
        inputs += [logit(cell.p) if cell.count else 0 for cell in cells]
        dot = clip(sum(w * x for w, x in zip(weights, inputs, strict=False)) >> 16, 3072)
        p = min(max(round(65536 / (1 + math.exp(-dot / 256))), 1), 65535)
        bit = self.bit(p)
        error = (bit * 65536 - p) * round(4 + 2600 / (100 + uses[0]))
        for k in range(len(inputs)):
            weights[k] += (inputs[k] * error + 2**19) >> 20
        uses[0] = min(uses[0] + 1, 4095)
        for cell in cells:
            if not cell.count:
                cell.p = p << 4
            cell.learn(bit)
        return bit

    def excess(self):
        exponent = 0
        while exponent < 61:
            more = self.bit(max(self.exponents[exponent].p >> 4, 1))
            self.exponents[exponent].learn(more)
            if not more:
                break
            exponent += 1
        value, left = 0, exponent
        while left:
            chunk = min(left, 32)
            value, left = value << chunk | self.coder.bits(chunk), left - chunk
        return 2**exponent - 1 + value


class Predictor:
    def __init__(self, sides, guided=False):
        self.steps, self.side_steps = [0] * 8, [[0] * 4 for _ in range(sides)]
        inputs = 8 + 4 * sides + 3 * guided
        self.energies, self.digits, self.weights = [0] * inputs, [3] * inputs, [0] * inputs
        self.errors, self.level, self.slope = [1024] * 8, 0, 0

    def inputs_of(self, side_steps, shift, side_shifts, guide_steps=()):
        def small(value, by):
            return clip(value >> by, 2**26)

        s = self.steps
        chosen = [s[0], s[0] - s[1], s[0] - 2 * s[1] + s[2], s[0] - 3 * s[1] + 3 * s[2] - s[3]]
        chosen += [s[j - 1] - s[j] for j in range(4, 8)]
        self.inputs = [small(value, shift) for value in chosen]
        for k, step in enumerate(side_steps):
            before, now = self.side_steps[k], clip(step * 16, 2**56)
            chosen = [now, now - before[0], now - 2 * before[0] + before[1], before[1] - before[2]]
            self.inputs += [small(value, side_shifts[k]) for value in chosen]
            self.side_steps[k] = [now, *before[:3]]
        self.inputs += [small(value, shift) for value in guide_steps]

    def predict(self, ratio, shift, guide_steps=()):
        a, b = self.steps[:2]
        dot = sum(w * x for w, x in zip(self.weights, self.inputs, strict=True))
        self.candidates = [
            0,
            a,
            clip(a, 2**48) * ratio >> 8,
            clip(dot >> 16, 2**56 >> shift) << shift,
            clip(self.level + self.slope, 2**56),
            2 * a - b,
            *guide_steps[:2],
        ]
        errors = self.errors[: len(self.candidates)]
        least = min(errors)
        best = self.candidates[errors.index(least)]
        total = weights = 0
        for candidate, error in zip(self.candidates, errors, strict=True):
            if error + 4 <= 8 * (least + 4):
                weight = ((least + 4 << 10) // (error + 4)) ** 2 >> 10
                weight = weight**2 >> 10
                total += weight * clip(candidate - best, 2**48)
                weights += weight
        return best + total // weights

    def learn(self, step, scale, shift):
        for k, candidate in enumerate(self.candidates):
            error = min(abs(step - candidate), 20 * scale)
            self.errors[k] += (4 * error - self.errors[k]) >> 4
        error = clip(clip(step - self.candidates[3], 6 * scale) >> shift, 2**26)
        for j, x in enumerate(self.inputs):
            self.energies[j] += (x * x * 16 - self.energies[j]) >> 5
            self.digits[j] = max((self.energies[j] >> 4).bit_length(), 3)
            self.weights[j] += (error * x << 8) >> max(self.digits[j] - 2, 0)
            self.weights[j] = clip(self.weights[j], 2**24)
        expected = self.candidates[4]
        error = clip(step - expected, 2**56)
        self.level = expected + (error * 16 >> 6) - step
        self.slope = clip(self.slope + (error * 8 >> 8), 2**56)
        self.steps = [clip(step, 2**56), *self.steps[:7]]

    def forget(self):
        self.steps, self.level, self.slope = [0] * 8, 0, 0
        self.side_steps = [[0] * 4 for _ in self.side_steps]


class RowsGuide:
    """What a guide says of each row: a number in sixteenths and its class."""

    def __init__(self, numbers, classes):
        self.numbers, self.classes = numbers, classes

    def at(self, i, last):
        now = self.numbers[i]
        later = self.numbers[i + 1] - now if i + 1 < len(self.numbers) else 0
        return self.classes[i], now, now - self.numbers[i - 1], later


class KnotsGuide:
    """Runs of rows, each with the times in sixteenths and classes of the knots of its walk."""

    def __init__(self, runs, slack):
        self.runs, self.slack, self.run, self.passed = runs, slack, None, 0

    def at(self, i, last):
        first, knots = max(
            ((first, knots) for first, knots in self.runs if first <= i), key=lambda run: run[0]
        )
        if first != self.run:
            self.run, self.passed = first, 0
        if first < i:
            while self.passed < len(knots) and knots[self.passed][0] <= last + self.slack:
                self.passed += 1
        knots = knots[self.passed :]
        if not knots:
            return 0, 0, 0, 0
        now, kind = knots[0]
        later = knots[1][0] - now if len(knots) > 1 else 0
        return kind, now, now - last, later


class ColumnDecoder:
    def __init__(self, payload, setting, times, sides, side_shifts, side_sizes, guide=None):
        self.mixture = Mixture(Decoder(payload))
        self.setting, self.times = setting, times
        self.sides, self.side_shifts, self.side_sizes = sides, side_shifts, side_sizes
        self.scales, self.last_sizes, self.elapsed = [setting.scale] * 2, [0, 0], 0
        self.guide, self.guide_errors = guide, [setting.scale * 16] * 8
        self.guide_uses, self.guide_class = [0] * 8, 0

    def decode(self, first, count):
        """Values and classes of errors."""
        values, sizes, setting = [first], [0], self.setting
        predictor = Predictor(len(self.sides), self.guide is not None)
        for i in range(1, count):
            ratio = self.ratio(i)
            side_steps = [side[i] - side[i - 1] for side in self.sides]
            guide_steps = self.look_up(i, 16 * values[-1])
            predictor.inputs_of(side_steps, setting.shift, self.side_shifts, guide_steps)
            candidates = guide_steps if self.guide_class else []
            self.center = clip(predictor.predict(ratio, setting.shift, candidates), 2**57)
            self.scale = max((self.scales[0] + 2 * self.scales[1]) // 3, 3)
            self.bases = self.contexts(i, predictor, side_steps, ratio)
            step, is_outlier = self.step()
            values.append(values[-1] + step)

            if self.guide_class:
                self.learn_guide(step * 16)
            error = step * 16 - self.center
            size = min(half_octaves(min(abs(error), 2**57) * 4 // self.scale + 1), 9)
            sizes.append(size)
            self.last_sizes = [size if error >= 0 else -size, self.last_sizes[0]]
            limited = min(abs(error), 20 * self.scale) if is_outlier else abs(error)
            for k, shift in enumerate((4, 6) if is_outlier else (3, 5)):
                self.move_scale(k, limited, shift)
            if is_outlier:
                predictor.forget()
                continue
            predictor.learn(step * 16, self.scale, setting.shift)
            if len(self.times):
                self.elapsed = max(self.times[i] - self.times[i - 1], 1)
        return values, sizes

    def look_up(self, i, last):
        """Steps to what the guide says."""
        if self.guide is None:
            return []
        self.guide_class, number, own, later = self.guide.at(i, last)
        if not self.guide_class:
            return [0, 0, 0]
        self.guide_center = clip(number - last, 2**60)
        self.guide_scale = max(self.guide_errors[self.guide_class] >> 4, 3)
        is_knot = isinstance(self.guide, KnotsGuide)
        return [self.guide_center, self.guide_center if is_knot else own, later]

    def learn_guide(self, step):
        k = self.guide_class
        error = min(abs(step - self.guide_center), 20 * self.guide_scale, 2**46)
        self.guide_uses[k] = min(self.guide_uses[k] + 1, 32)
        self.guide_errors[k] += (16 * error - self.guide_errors[k]) // self.guide_uses[k]

    def ratio(self, i):
        if not len(self.times) or self.elapsed <= 0 or self.times[i] <= self.times[i - 1]:
            return 256
        elapsed = min(self.times[i] - self.times[i - 1], 2**40)
        return min(max(elapsed * 256 // self.elapsed, 32), 2048)

    def move_scale(self, k, error, shift):
        difference = error - self.scales[k]
        move = difference >> shift
        if abs(difference) <= 2**shift:
            move = 1 if difference > 0 else -1
        self.scales[k] = min(max(self.scales[k] + move, 2), 2**46)

    def contexts(self, i, predictor, side_steps, ratio):
        time_class = half_octaves(ratio) if len(self.times) else 0
        if self.setting.order == 1:
            last, before = (clip(step >> 4, 31) + 31 for step in predictor.steps[:2])
            other = clip(side_steps[0] if side_steps else 0, 31) + 31
            return [
                0,
                (last * 64 + before + 1) * 0x5851F42D4C957F2D,
                (other + 64 * time_class + 1) * 0x2545F4914F6CDD1D,
            ]
        scale = (self.scales[0] + 2 * self.scales[1]) // 3
        phase = self.center % 16 >> 2 if scale < 64 else 0
        stay = clip(-4 * self.center // scale, 9) + 9
        side_size = max((sizes[i] for sizes in self.side_sizes), default=0)
        last, before = self.last_sizes
        return [
            min(half_octaves(scale), 20) * 4 + phase,
            stay * 21 + time_class,
            ((last + 10) * 12 + abs(before)) * 3 + min(side_size // 3, 2),
        ]

    def slots(self, node, low, high):
        """Number and cell of each context."""
        if self.setting.order == 0:
            return [(k, (base * 32 + node) % 2**14) for k, base in enumerate(self.bases)]
        usual = self.setting.usual
        key = (low - usual) * 0x9E3779B1 + (high - usual) * 0x2545F4914F6CDD1D
        key *= 0x5851F42D4C957F2D
        return [
            (k, (base % 2**64 ^ key % 2**64) >> 40 & 2**14 - 1) for k, base in enumerate(self.bases)
        ]

    def threshold(self, side, number):
        setting = self.setting
        if setting.order == 1:
            bound = EXACT_BOUNDS[number] << setting.unit
            return setting.usual + (bound if side else -bound)
        bound = self.scale * NEAR_BOUNDS[number] >> 4
        # The first step at or past the bound; on the lower side the first that is nearer.
        up = -(-(self.center + bound) // 16)
        return up if side else 1 + (self.center - bound) // 16

    def step(self):
        setting, scale, low, high = self.setting, self.scale, -(2**60), 2**60
        sharpness = 2 if scale < 4 else 1 if scale < 16 else 0
        digits = max(scale.bit_length() - 16, 0)
        inverse = (1420 << 18) // (scale >> digits)
        below, above = guide_below, guide_above = 0, 65536
        if self.guide_class:
            guide_digits = max(self.guide_scale.bit_length() - 16, 0)
            guide_inverse = (1420 << 18) // (self.guide_scale >> guide_digits)

        def decide(threshold, node):
            nonlocal low, high, below, above, guide_below, guide_above
            if not low < threshold < high:
                return int(threshold <= low)
            distance = clip((threshold * 16 - 8 - self.center) >> digits, 2**24)
            middle = mass_below(distance, inverse)
            ratio = log_ratio(above - middle, middle - below)
            slots = self.slots(node, low, high)
            if setting.contexts == 2:
                # Near a prediction the mean error is left out, of exact steps the other column.
                slots = slots[1:] if setting.order == 0 else slots[:2]
                slots = slots[:1] if self.guide_class else slots
            row, guide_ratio = sharpness * 33 + node, None
            if self.guide_class:
                distance = clip((threshold * 16 - 8 - self.guide_center) >> guide_digits, 2**24)
                guide_middle = mass_below(distance, guide_inverse)
                guide_ratio = log_ratio(guide_above - guide_middle, guide_middle - guide_below)
                place = clip((distance * guide_inverse >> 18) * 3 >> 11, 15) + 15
                slots.append(("guide", ((place * 8 + self.guide_class) * 64 + node) % 2**14))
                row += 99 * self.guide_class
            bit = self.mixture.decide(row, ratio, slots, guide_ratio)
            if self.guide_class:
                if bit:
                    guide_below = guide_middle
                else:
                    guide_above = guide_middle
            below, above = (middle, above) if bit else (below, middle)
            low, high = (threshold, high) if bit else (low, threshold)
            return bit

        side = decide(self.threshold(1, 0), 0)
        number = setting.first_bin
        is_outer = decide(self.threshold(side, number), side * 16 + number) == side
        if is_outer:
            while number < 15:
                if decide(self.threshold(side, number + 1), side * 16 + number + 1) != side:
                    break
                number += 1
        else:
            number -= 1
            while number > 0:
                if decide(self.threshold(side, number), side * 16 + number) == side:
                    break
                number -= 1
        if number == 15:
            excess = self.mixture.excess()
            return (low + excess if side else high - 1 - excess), True
        if setting.order == 1:
            for _ in range(8):
                if high - low <= 1:
                    break
                decide((low + high) >> 1, 32)
        return low + self.rest(high - low), False

    def rest(self, width):
        if width <= 1:
            return 0
        digits = 0
        while (width - 1) >> digits >= 2**32:
            digits += 16
        total = (width - 1 >> digits) + 1
        part = self.mixture.coder.decode_cumulative(total)
        self.mixture.coder.interval(part, 1, total)
        for _ in range(digits // 16):
            part = part << 16 | self.mixture.coder.bits(16)
        return part


def mass_below(distance, inverse):
    z = (distance * inverse >> 18) + 16 * 1024
    if z <= 0:
        return 0
    if z >= 32 * 1024:
        return 65536
    j = z >> 4
    return LOGISTIC[j] + ((LOGISTIC[j + 1] - LOGISTIC[j]) * (z & 15) >> 4)
